"""What a user gives by mistake is refused in a sentence, and nothing else is printed."""

import pickle
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import rsgen as rs
from rsgen.common.errors import RsgenError
from rsgen.data.oscillator import Model
from tests.virtual import fundamentals, simulated

LAW = "k*x + c*v"
TRUE = {"k": 5000.0, "c": 4.0}
JENKINS = "k*x + c*v + masing(Min(kt*x, Fs))"
STICKING = rs.Oscillator(1.5, f"{LAW} + F*sign(v)", {**TRUE, "F": 0.2})
GROWING = rs.Oscillator(1.5, "-k*x + c*v - kn*x**3", {"k": 6000.0, "c": 1.0, "kn": 1e9})
SILENT = rs.MultisineSpectra([1.0], 3.0, np.ones((1, 30)), np.zeros((1, 30)))
OWN_POWER = rs.Law("k*x + c*v + z", memory={"z": "a*v - b*abs(v)*z*abs(z)**(n - 1)"})
FIVE = rs.Observation(hold_out=(5.0,))


@pytest.fixture(scope="module")
def surface():
    return fundamentals(simulated(LAW, TRUE, [1.0, 2.0], (8, 13, 21), 1.2, method="harmonic-balance"))


@pytest.fixture(scope="module")
def found(surface):
    return rs.identify(surface, LAW)


def parts_of(name, thing, depth=4):
    """Yield an object and what a user reads of it, but for the numbers of arrays, each with its place."""
    yield name, thing
    inner = dict(enumerate(thing)) if isinstance(thing, tuple) else {}
    for one in fields(thing) if is_dataclass(thing) else ():
        if one.name[0] != "_" and one.name != "fit":
            inner[one.name] = getattr(thing, one.name)
    for key, value in inner.items() if depth else ():
        if not isinstance(value, np.ndarray):
            yield from parts_of(f"{name}.{key}", value, depth - 1)


def test_every_result_prints_in_few_lines(surface):
    held = rs.identify(surface, f"{LAW} + k3*x**3", rs.Observation(hold_out=2, background=None))
    made = {
        "found": held, "surface": surface, "prediction": rs.predict(held, [1.0], surface),
        "modal": rs.modal_table(surface), "ranking": rs.rank(surface, [LAW, "k*x + c*v + k3*x**3"]),
        "profile": rs.profile(held, "k"), "function": rs.derive(f"{LAW} + k3*x**3"),
        "fits": rs.compare_fits([held, held]), "case": rs.load_case("cases/cubic.toml"),
        "test": rs.SimulatedTest([1.0, 2.0], np.linspace(8, 12, 200)), "spectra": SILENT, "laws": rs.laws,
    }  # fmt: skip
    texts = {place: repr(part) for one in made.items() for place, part in parts_of(*one)}
    assert [place for place, text in texts.items() if text.count("\n") > 39 or len(text) > 5000] == []
    assert "frequency=array of shape (21,)" in repr(held.held_out)
    assert held.model.observation == rs.Observation(hold_out=(2.0,), background="none")


def each(call, *rows):
    """A refusal for each of several values of an argument."""
    return [(lambda s, f, value=value: call(s, value), said) for value, said in rows]


@pytest.mark.parametrize(("call", "said"), [
    *each(lambda s, keys: rs.Observation(**keys),
        ({"hold_out": "all"}, "hold_out: levels: 'all'"), ({"background": "smooth"}, "background"),
        ({"band": "9 Hz"}, "band: two frequencies in Hz"), ({"band": (5.0, 4.0)}, "ascending"),
    ),
    (lambda s, f: rs.identify(s, LAW, "residuals"), "observation: str; must be Observation"),
    (lambda s, f: rs.identify(s, LAW, mass="1.2 kg"), r"mass: '1.2 kg'; must be a number \[kg\]"),
    (lambda s, f: rs.identify(s, ["k*x", "c*v +"]), r"law 'c\*v \+': column 5: the formula ends in '\+'"),
    (lambda s, f: rs.identify(s, "k*x + m*v"), "named m, which is the mass"),
    (lambda s, f: rs.identify(s.select(np.zeros(len(s), dtype=bool)), LAW), "0 of 0 points"),
    (lambda s, f: rs.rank(s, rs.Observation()), "candidates: Observation; write observation="),
    (lambda s, f: rs.compare(f, f), "truth: Identification; rs.compare_fits sets"),
    (lambda s, f: rs.compare_fits(f, f), "give a list of fits"),
    (lambda s, f: rs.predict(f, s), "did you mean surface="),
    (lambda s, f: rs.profile(rs.identify(s, LAW, fixed={"c": 4.0}), "c"), "c is fixed"),
    (lambda s, f: rs.identify(s, LAW, fixed={"mass": 1.2}), "the mass is m"),
    (lambda s, f: rs.write_report(5, s, f), "folder: int; must be str or Path"),
    (lambda s, f: rs.Oscillator(0.0, LAW, TRUE), "mass"),
    (lambda s, f: rs.Oscillator(Model("k*x")), r"mass: Model\('k\*x'\); must be a number \[kg\]"),
    (lambda s, f: rs.Oscillator(1.0, "k*x", {}), "missing k"),
    (lambda s, f: rs.Oscillator(1.0, "k*x", {"k": 1.0, "q": 2.0}), "unknown q"),
    (lambda s, f: rs.Oscillator(1.0, "k*x", {"k": np.nan}), r"values\.k"),
    (lambda s, f: Model([rs.make_element("spring", law) for law in ("k*x", "c*v")]), "spring"),
    (lambda s, f: Model(JENKINS, fixed={"Fs": -1.0}), r"fixed\.Fs: is -1; a number above 0 is needed"),
    (lambda s, f: Model(LAW, mass=2.0, fixed={"m": 1.0}), "mass: 2 kg, and 1 kg in fixed; give it once"),
    (lambda s, f: rs.rank(s, Model(LAW, fixed={"k": 1.0})), "of what is fixed only the mass"),
    (lambda s, f: rs.identify(s.select(np.arange(3)), LAW), "identification needs at least"),
    (lambda s, f: rs.identify(s, LAW, FIVE), "no level 5 N"),
    (lambda s, f: rs.identify(replace(s, level=np.arange(42) + 1.5), LAW, FIVE), "give all of a sweep its"),
    (lambda s, f: rs.identify(SILENT, LAW), "record 1 of 1: the response is zero"),
    (lambda s, f: rs.ResponseSurface([1 + 1j], [9.0], [1 + 1j], [1j]), r"surface\.level: complex numbers"),
    (lambda s, f: rs.profile(f, "k9"), "is no parameter with a value here; those are c, k, m"),
    (lambda s, f: rs.predict(f.oscillator), "give the force levels"),
    (lambda s, f: rs.predict(rs.Oscillator(1.0, LAW, {"k": 1.0, "c": 0.0}), 1.0), "needs damping"),
    (lambda s, f: rs.predict(f.oscillator, 1.0, band=(3.0, 2.0)), "ascending"),
    (lambda s, f: rs.predict(f.oscillator, 1.0)[3.0], "level '3': there is none; there are 1"),
    (lambda s, f: rs.modal_table(s.select(s.frequency < 9)), "points lie within 45 degrees of resonance"),
    (lambda s, f: rs.modal_table(s, "k*x"), "about"),
    (lambda s, f: rs.modal_table(fundamentals(s, -s.harmonics[:, 1])), "feed the exciter"),
    (lambda s, f: rs.modal_table(s).at([1e-3, -1.0]), "positive and finite"),
    (lambda s, f: rs.compare_fits([f, f, f], ["a", "b"]), "names: 2 of 3 fits"),
    (lambda s, f: rs.compare(f, TRUE, {"k9": 1e-3}), "k9: not identified; allowed are c, k, m"),
    (lambda s, f: rs.compare(f, {"k": 1.0}, {"c": 1e-3}), "no truth for c"),
    (lambda s, f: rs.figures.draw_surface(s, ax=Figure().add_subplot()), 'projection="3d"'),
    (lambda s, f: rs.MultisineTest((1.0,), (2, 20), 0.01), r"no line of a period of 0\.01 s is in it"),
    (lambda s, f: rs.MultisineTest((1.0,), (2, 2e3), 200.0, periods=1000), "of all periods; at most"),
    (lambda s, f: rs.simulate(STICKING, rs.MultisineTest((0.2,), (2.5, 20), 2.0)), r"0\.2 N: .*dry friction"),
    (lambda s, f: rs.SweepTest([1], (8, 14), duration=10, rate=100), "rate: 100 Hz; at least 8 t"),
    (lambda s, f: rs.DecayTest([1e-3], duration=1e6, rate=400), "samples of all records; at most"),
    (lambda s, f: rs.simulate(GROWING, rs.DecayTest([1e-2], duration=10, rate=400)), "grows without"),
    (lambda s, f: rs.SimulatedTest([1.0], [-1.0]), "frequency"),
    *each(lambda s, keys: rs.SimulatedTest([1.0], [8.0], **keys),
        ({"control": "none"}, "'force', 'response', 'phase' or 'continuation' is needed"),
        ({"harmonics": 100}, "1 to 64"), ({"lags": (1.0,)}, "phase-locked loop"),
        ({"control": "phase", "sweep": "up"}, "finds its frequency"),
        ({"control": "phase", "lags": (90.0,)}, "lags"),
        ({"control": "phase", "base": "acceleration"}, "leave one of them out"),
    ),
    (lambda s, f: rs.Law("k*x*cos(2*w*t)"), "is the time"),
    (lambda s, f: rs.Law("k*x + cubic-spring"), "is a law of the library.*rsgen.laws"),
    *each(rs.identify,
        ("kx + c*v", r"law 'kx \+ c\*v': kx is one name.* write k\*x"),
        ("k*x + c*xdot", "xdot is one name.* write v for the velocity"),
    ),
    (lambda s, f: rs.identify(s, OWN_POWER), r"z: a force to a power .* Fs\*z, .* fixed=\{'n': 1\}"),
    (lambda s, f: rs.rank(s, "F1 - F2"), "no candidate has forces"),
    *each(lambda s, keys: replace(s, **keys),
        ({"frequency": np.full(42, -3.0)}, "positive"), ({"force": [1.0, 2.0]}, "force"),
        ({"harmonics": np.ones((42, 1))}, "fundamental"),
        ({"sweep": ["left"] * 42}, "sweep"), ({"outcome": np.full(42, 99)}, "outcome"),
    ),
    (lambda s, f: rs.ResponseSurface(1, [8, 9], 1, [1e-3, 2e-3]), "phase_known=False"),
    (lambda s, f: rs.ResponseSurface(1, [8, 9], [1, 1, 1], [1j, 1j]), r"force: shape \(3,\)"),
    (lambda s, f: rs.ResponseSurface(1, [[8, 9]], 1, [[1j, 1j]]), r"\(n,\), one row .*; ravel all arguments"),
    (lambda s, f: rs.ResponseSurface([1, 2], [8, 9, 10], *(1j * np.ones((2, 2, 3)))), "np.repeat the levels"),
    *each(lambda s, call: call(s),
        (lambda s: rs.identify(s, LAW, hold_out=[2]), "hold_out: no .* observation=rsgen.Observation"),
        (lambda s: rs.simulate(STICKING, test=1, levels=2), "its arguments are oscillator, test, pro"),
        (lambda s: rs.predict(STICKING, level=1.0), "level: no argument; did you mean 'levels'"),
        (lambda s: rs.rank(s, fixed={"m": 1.0}), "fixed: no argument; the mass alone can be given"),
        (lambda s: rs.Observation(delay=1e-3), "Observation: delay: .* are background, hold_out"),
    ),
    (lambda s, f: rs.explain("rejected"), "verdict: str; must be Verdict"),
    (lambda s, f: rs.predict(s, levels=[1]), "must be Identification or ModalTable or Oscillator"),
    (lambda s, f: rs.predict(f, levels=[]), "levels: must be one or more"),
    (lambda s, f: rs.simulate(rs.SimulatedTest([1], [9]), f.oscillator), "oscillator: Sim"),
    (lambda s, f: rs.save_surface(s, "a.h5"), "surface: str"),
    (lambda s, f: rs.load_surface("absent.h5"), "absent.h5: there is no such file"),
    (lambda s, f: rs.read("test.mat"), "test.mat: not a case .* rsgen init --from"),
    (lambda s, f: rs.figures.draw_collapse(s), "draw_collapse: ResponseSurface; must be Identification"),
])  # fmt: skip
def test_a_wrong_argument_is_refused_in_a_sentence(surface, found, call, said):
    with pytest.raises(RsgenError, match=said):
        call(surface, found)


def test_a_pickled_result_has_its_residuals_and_says_that_it_has_no_fit_to_profile(found):
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.residuals, found.residuals)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(again)).residuals, found.residuals)
    assert again.values == found.values
    with pytest.raises(RsgenError, match="which pickle does not keep"):
        rs.profile(again, "k")


def test_a_misfit_of_the_law_is_not_printed_as_noise(surface, found):
    stiffness = TRUE["k"] * (1 + 0.05 * surface.level)
    omega = 2 * np.pi * surface.frequency
    stiffer = surface.level / (stiffness - 1.2 * omega**2 + 1j * omega * TRUE["c"])
    wrong = str(rs.identify(fundamentals(surface, stiffer), LAW))
    assert "systematic, not noise" in wrong
    assert "noise 1" not in wrong


def test_a_result_is_an_oscillator_and_prints_sentences(found, surface):
    again = rs.simulate(found.oscillator, rs.SimulatedTest([1.0, 2.0], np.linspace(8, 13, 21)))
    assert np.allclose(again.amplitude, surface.amplitude, rtol=1e-4)
    wrong = rs.identify(fundamentals(surface, -surface.harmonics[:, 1]), LAW)
    assert "error: the structure would feed energy into the exciter" in str(wrong)
