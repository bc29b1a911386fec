"""The modal table against closed forms, and its intervals against repeated noise; no law takes part."""

import csv
import io

import numpy as np
import pytest

import rsgen
from rsgen import ResponseSurface, RsgenError
from rsgen.common.tolerances import interval_sigmas
from rsgen.data.oscillator import Model, Observation
from rsgen.identification.fitting.observed import Observed
from rsgen.identification.fitting.points import Points, select_points
from rsgen.identification.modal_result import ModalSplines, ModePoints, SplineBasis, other_mass
from rsgen.identification.modal_table import ModeProblem
from rsgen.report.page_tables import tabulate_mode
from tests.samples import C1, K1, KN1, MASS, cubic_surface
from tests.surfaces import beside, codes, noisy, without_phase
from tests.virtual import fundamentals, only, simulated

SURFACE = cubic_surface(levels=6, frequencies=41)


def omega_of(amplitude: np.ndarray) -> np.ndarray:
    """First-order resonance of the softening spring [rad/s], Liu et al., Eq. (13)."""
    return np.sqrt((K1 + 0.75 * KN1 * amplitude**2) / MASS)


def measured(X: np.ndarray, omega: np.ndarray, force: np.ndarray) -> ResponseSurface:
    """Points of these amplitudes under a force whose phase counts from the response."""
    size = np.abs(force)
    return ResponseSurface(size, omega / (2 * np.pi), size, X * np.exp(-1j * np.angle(force)))


def inside(table: rsgen.ModalTable, name: str, true: np.ndarray) -> np.ndarray:
    """Where the interval of a column contains what is true."""
    return (getattr(table, f"{name}_lower") <= true) & (true <= getattr(table, f"{name}_upper"))


def phase_resonance(amplitudes: np.ndarray, kn: float | np.ndarray = KN1):
    """One point a level, at a lag of a quarter period, to first order."""
    omega = np.sqrt((K1 + 0.75 * kn * amplitudes**2) / MASS)
    return measured(amplitudes, omega, 1j * omega * C1 * amplitudes)


def test_a_linear_mode_has_the_same_row_at_every_amplitude():
    omega = 2 * np.pi * np.linspace(9, 11, 41)
    surface = ResponseSurface(2.0, omega / 2 / np.pi, 2.0, 2 / (5000 - 1.25 * omega**2 + 2j * omega))
    table = rsgen.modal_table(surface)
    expected = {
        "mass": 1.25, "omega": np.sqrt(4000), "damping_ratio": 2 / (2 * np.sqrt(5000 * 1.25)),
        "stiffness": 5000, "damping": 2, "stiffness_per_mass": 4000, "damping_per_mass": 1.6,
    }  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(table, name), value, rtol=1e-9)


def test_stiffness_and_damping_of_a_cubic_spring_follow_its_describing_function():
    table = rsgen.modal_table(SURFACE)
    X = table.amplitude
    np.testing.assert_allclose(table.omega, omega_of(X), rtol=5e-5)
    np.testing.assert_allclose(table.stiffness, K1 + 0.75 * KN1 * X**2, rtol=1e-4)
    np.testing.assert_allclose(table.damping, C1, rtol=2e-4)
    assert X[0] < 0.3 * X[-1]


def test_without_a_mass_phase_resonance_determines_stiffness_per_mass_and_damping_alone():
    X = np.geomspace(5e-3, 5e-2, 9)
    table = rsgen.modal_table(phase_resonance(X))
    assert table.known == ("frequency", "damping", "stiffness_per_mass")
    np.testing.assert_allclose(table.omega, omega_of(table.amplitude), rtol=1e-4)
    np.testing.assert_allclose(table.damping, C1, rtol=1e-6)
    assert np.isnan([*table.stiffness, *table.damping_ratio, table.mass]).all()
    assert [finding.code for finding in table.findings] == ["mass-at-resonance"]
    row = next(csv.DictReader(io.StringIO(table.to_csv())))
    assert row["stiffness [N/m]"] == row["lower damping_ratio [1]"] == ""
    with pytest.raises(RsgenError, match="give the mass"):
        rsgen.predict(table, [1.0])
    bent = rsgen.modal_table(phase_resonance(X, kn=KN1 * (1 + 100 * X**2)))
    assert np.all(bent.frequency_upper - bent.frequency_lower < 1e-3 * bent.frequency)


def softening_beside_a_mode(seed: int, residue: float = 0.25) -> ResponseSurface:
    """A softening mode with drag, 305 points with 0.6 % noise, and a mode at 61 Hz of a residue [1/kg]."""
    law, values = "k*x + k3*x**3 + c*v + cq*v*abs(v)", {"k": 5.2e4, "k3": -2.1e7, "c": 4.1, "cq": 38.0}
    how = {"harmonics": 1, "method": "harmonic-balance"}
    test, own = simulated(law, values, [2.0, 4, 8, 14, 20], (20, 27.5, 61), 2.3, **how), 2 * np.pi * 61
    seen = beside(test, residue * test.force / (own**2 - test.omega**2 + 0.02j * own * test.omega))
    error = np.random.default_rng(seed).normal(size=(3, len(test)))
    response = seen.harmonics[:, 1] + 0.006 / 2**0.5 * seen.amplitude * (error[0] + 1j * error[1])
    return fundamentals(test, response, test.force * (1 + 0.004 * error[2]))


def test_a_mass_that_splines_and_background_hide_is_that_of_the_first_background():
    amplitude = np.array([1e-3, 2e-3, 4.8e-3])
    stiffness = 5.2e4 - 0.75 * 2.1e7 * amplitude**2
    frequency = np.sqrt(stiffness / 2.3) / (2 * np.pi)
    damping = 4.1 + 8 / (3 * np.pi) * 38 * 2 * np.pi * frequency * amplitude
    for seed in (3, 4, 5):
        whole = rsgen.modal_table(softening_beside_a_mode(seed), Observation("residuals"))
        table = whole.at(amplitude)
        assert table.points == 305
        assert [(f.code, f.parameter, f.severity) for f in table.findings] == [("confounded", "m", "warning")]
        for name, true in (("frequency", frequency), ("stiffness", stiffness), ("damping", damping)):
            assert inside(table, name, true).all()
            assert getattr(table, name) == pytest.approx(true, rel=0.02)


def test_a_neighbour_that_is_noise_or_the_mode_itself_is_named():
    seen = softening_beside_a_mode(1, residue=0.0)
    found = rsgen.identify(seen, "k*x + k3*x**3 + c*v + cq*v*abs(v)", Observation("neighbour"))
    (named,) = found.background.findings
    assert (named.code, named.parameter) == ("not-distinct-from-zero", "r")
    unknown = {e.name for e in found.background.estimates if not e.identifiable}
    assert unknown == {"r_re", "r_im", "f_n", "zeta"}
    assert all(e.identifiable for e in found.refined)


def test_amplitudes_alone_are_enough():
    table = rsgen.modal_table(without_phase(SURFACE))
    inner = slice(2, -2)
    np.testing.assert_allclose(table.omega[inner], omega_of(table.amplitude)[inner], rtol=1e-3)
    np.testing.assert_allclose(table.damping[inner], C1, rtol=0.02)


@pytest.mark.parametrize("level", [3.2, 12.0])
def test_a_held_out_level_is_predicted_without_a_law(level):
    asked = float(SURFACE.levels[np.argmin(np.abs(SURFACE.levels - level))])
    table = rsgen.modal_table(SURFACE, Observation(hold_out=(asked,)))
    prediction = rsgen.predict(table, None, SURFACE)
    (scored,) = prediction.held_out
    known = np.isfinite(scored.predicted)
    assert scored.error < 1e-3
    assert known.all() == (level < 12)
    if level == 12:
        assert np.nanmax(np.abs(scored.predicted)) < 1.011 * table.tested[1]
        assert scored.missing == np.count_nonzero(~known)
        assert "held-out-points-missing" in codes(prediction)
        return
    # the resonance curve by the closed formula of the law that nobody told it
    curve = prediction[asked]
    X, omega = curve.amplitude, 2 * np.pi * curve.frequency
    force = X * np.abs(K1 + 0.75 * KN1 * X**2 - MASS * omega**2 + 1j * omega * C1)
    near = (table.tested[0] < X) & (table.tested[1] > X)
    np.testing.assert_allclose(force[near], asked, rtol=2e-3)


def test_a_curve_ends_where_the_table_ends_and_its_peak_is_not_known():
    table = rsgen.modal_table(SURFACE)
    top = SURFACE.levels[-1]
    for level, ends in ((0.9 * top, False), (1.5 * top, True)):
        predicted = rsgen.predict(table, level)
        assert predicted.curves[0].rises_at_end is ends
        assert [found.names["by"] for found in predicted.findings] == ["table"] * ends
    assert table.amplitude[-1] == pytest.approx(SURFACE.amplitude.max(), rel=0.02)


SIZES, TESTED = np.geomspace(1e-3, 2e-2, 30), (1e-3, 2e-2)


@pytest.mark.parametrize("power", [2, 1, 0, -1])
def test_slopes_of_splines_are_by_the_logarithm_of_the_amplitude(power):
    basis, h = SplineBasis.over(SIZES, TESTED, 2, 3, power), 1e-6
    inside = np.geomspace(1.3e-3, 1.8e-2, 17)
    up, down = (basis(inside * np.exp(step)) for step in (h, -h))
    slope = (up - down) / (2 * h)
    assert np.abs(basis.slopes(inside) - slope).max() < 1e-6 * np.abs(slope).max()


def flat(stiffness: float, damping: float, mass: float, others=()) -> ModalSplines:
    basis = SplineBasis.over(SIZES, TESTED, 0, 1, 1)
    return ModalSplines(basis, (1,), np.array([stiffness, damping]), mass, np.zeros((3, 3)), 10, others)


def test_shapes_that_fit_as_well_count_by_their_weight():
    # variance between models: the sum of w_i (value_i - value)^2 (Burnham and Anderson, 2002, Sec. 4.3)
    others = ((0.25, flat(5200.0, 4.4, 1.5)), (0.75, flat(5000.0, 4.0, 1.6)))
    k, c, errors = flat(5000.0, 4.0, 1.5, others).at(np.array([5e-3]))
    assert (k[0], c[0]) == pytest.approx((5000.0, 4.0))
    expected = [0.25 * 200**2, 0.25 * 0.4**2, 0.75 * 0.1**2]
    assert np.diag(errors[0]) == pytest.approx(expected, rel=1e-9)


def steep(seed: int) -> ResponseSurface:
    """Fifty points of k = 9000 N/m + 9.4e12 X^4, c = 2 N s/m, m = 0.8 kg; 1 % noise of the response.

    At the largest amplitude the slope of k X is a hundred times the force per response near resonance.
    """
    X = np.repeat(np.geomspace(1.8e-3, 4.9e-3, 5), 10)
    k = 9000 + 9.4e12 * X**4
    omega = np.sqrt(k / 0.8) * (1 + np.tile(np.linspace(-0.04, 0.04, 10), 5))
    noise = np.random.default_rng(seed).normal(size=(2, len(X)))
    held = measured(X, omega, X * (k - 0.8 * omega**2 + 2j * omega))
    return fundamentals(held, held.harmonics[:, 1] * (1 + 0.01 * (noise[0] + 1j * noise[1])))


def test_intervals_of_stiffness_mass_and_frequency_follow_from_each_other():
    table = rsgen.modal_table(steep(1))
    mass = interval_sigmas(table.splines.freedom) * table.mass_error / table.mass
    stiffness, frequency = (
        (getattr(table, f"{name}_upper") - getattr(table, f"{name}_lower")) / 2 / getattr(table, name)
        for name in ("stiffness", "frequency")
    )
    assert (abs(mass - 2 * frequency) < stiffness * (1 + 1e-9)).all()
    assert (stiffness < (mass + 2 * frequency) * (1 + 1e-9)).all()
    assert 0.002 < mass < 0.05


def test_outside_of_the_points_the_end_rows_continue_without_intervals():
    spring = "k*x + k3*x**3 + c*v", {"k": 2e4, "k3": 3e8, "c": 6.0}
    how = {"noise_relative": 0.01, "seed": 5}
    table = rsgen.modal_table(simulated(*spring, [1.0, 2.0, 4.0], (12, 20, 81), 2.0, **how))
    low, high = table.tested
    beyond = table.at([low / 9, low / 1.03, low, high, 2 * high])
    for name in ("frequency", "stiffness", "damping"):
        ends = getattr(table, name)[[0, 0, 0, -1, -1]]
        assert getattr(beyond, name) == pytest.approx(ends, rel=1e-9)
        assert np.isnan(getattr(beyond, f"{name}_upper")).tolist() == [True, True, False, False, True]
    # on the flanks of a small level the linear spring is that of the first row
    (curve,) = rsgen.predict(table, [0.05]).curves
    largest = 0.05 / (table.damping[0] * 2 * np.pi * table.frequency[0])
    assert np.nanmax(curve.amplitude) == pytest.approx(largest, rel=2e-3)


def test_mass_and_stiffness_scatter_as_much_as_their_errors_say():
    tables = [rsgen.modal_table(steep(seed)).at([1.85e-3, 2.97e-3, 4.9e-3]) for seed in range(20)]
    stiffness = [(t.stiffness, (t.stiffness_upper - t.stiffness_lower) / 4) for t in tables]
    for found in (stiffness, [(t.mass, t.mass_error) for t in tables]):
        value, error = map(np.array, zip(*found, strict=True))
        said = np.sqrt(np.mean(error**2, axis=0)) / np.std(value, axis=0, ddof=1)
        # twenty realisations know their scatter to 16 %; the spread of shapes is added to it
        assert np.all((said > 0.6) & (said < 2.2)), said


def points_of(harmonics: np.ndarray, noise: float = 0.0) -> Points:
    """Eight points of k = 5000 N/m, c = 4 N s/m, m = 1.5 kg with these harmonics."""
    frequency = np.linspace(8.5, 10.0, len(harmonics))
    omega = 2 * np.pi * frequency
    force = (5000 - 1.5 * omega**2 + 4j * omega) * harmonics[:, 1]
    force *= 1 + noise * np.random.default_rng(9).standard_normal(len(omega))
    return select_points(ResponseSurface(np.abs(force), frequency, force, harmonics), Model("k*x + c*v"))


def test_the_mass_lacks_the_kinetic_energy_of_the_harmonics():
    # of x = X cos(wt) + 0.1 X cos(3wt) + 0.05 X cos(2wt): 9 * 0.01 + 4 * 0.0025 of the fundamental's
    harmonics = np.zeros((8, 4), dtype=complex)
    harmonics[:, 1:] = np.linspace(1e-3, 8e-3, 8)[:, None] * np.array([1.0, 0.05j, 0.1])
    assert points_of(harmonics).harmonics_share(1e-4) == pytest.approx(0.10, rel=1e-9)


def test_few_points_make_coefficients_dear():
    # AIC with the correction for n numbers and q coefficients: n log(mean square) + 2 q n/(n - q - 1)
    # (Hurvich and Tsai, Biometrika 76, 1989)
    harmonics = np.zeros((8, 2), dtype=complex)
    harmonics[:, 1] = np.linspace(1e-3, 8e-3, 8)
    points = points_of(harmonics, noise=0.01)
    tested = (1e-3, 8e-3)
    seen = ModePoints(Observed.of(points), points, np.zeros(0), tested, np.full(8, np.nan))
    problem = ModeProblem(seen, SplineBasis.over(points.amplitude, tested, 0, 1, 1), (1,), np.nan)
    found, price = problem.solve()
    size = np.abs(points.force)
    columns = points.amplitude * np.stack([size**0, 1j * points.omega, -(points.omega**2)])
    matrix, right = (columns / size).T, points.force / size
    matrix = np.concatenate([matrix.real, matrix.imag])
    right = np.concatenate([right.real, right.imag])
    own, squares, *_ = np.linalg.lstsq(matrix / np.abs(matrix).max(axis=0), right, rcond=None)
    assert found == pytest.approx(own / np.abs(matrix).max(axis=0), rel=1e-8)
    n, q = 16, 3
    assert price == pytest.approx(n * np.log(squares[0] / n) + 2 * q * n / (n - q - 1), rel=1e-8)


@pytest.mark.thorough
def test_the_order_of_the_damping_is_chosen_with_noise_on_both_sides():
    values = {"k": 9000.0, "k5": 9.4e12 * 8 / 5, "c": 1.9, "d": 2.0}
    how = {"sweep": "up", "harmonics": 1, "method": "harmonic-balance"}
    law = "k*x + k5*x**5 + c*v + d*v*abs(v)"
    exact = simulated(law, values, [0.5, 2.0, 5.0], (13, 22, 55), 0.8, **how)
    at = np.array([1.85e-3, 2.4e-3, 3.2e-3, 4.5e-3])
    omega = np.sqrt((9000 + 9.4e12 * at**4) / 0.8)
    hits = np.zeros(len(at))
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(size=(2, len(exact)))
        seen = exact.harmonics[:, 1] * (1 + 0.01 * (noise[0] + 1j * noise[1]))
        table = rsgen.modal_table(fundamentals(exact, seen)).at(at)
        hits += inside(table, "damping", 1.9 + 16 / 3 / np.pi * omega * at)
    assert (hits >= 17).all(), hits


@pytest.mark.thorough
def test_intervals_cover_what_they_say_under_noise():
    at = np.array([0.01, 0.02, 0.03])
    surface = SURFACE.select(np.abs(SURFACE.frequency - 9.95) < 0.9)
    hits, count = dict.fromkeys(("frequency", "damping_ratio", "stiffness"), 0), 0
    for seed in range(18):
        table = rsgen.modal_table(noisy(surface, 0.01, seed)).at(at)
        truth = {"frequency": omega_of(at) / (2 * np.pi), "stiffness": K1 + 0.75 * KN1 * at**2}
        truth["damping_ratio"] = C1 / (2 * MASS * omega_of(at))
        for name, true in truth.items():
            hits[name] += int(np.count_nonzero(inside(table, name, true)))
        count += len(at)
    # 95 % of 54, four standard deviations of a binomial below: wider than needed is allowed, narrower is not
    assert all(hit >= 0.95 * count - 4 * np.sqrt(0.95 * 0.05 * count) for hit in hits.values()), hits
    for name, most in (("frequency", 1e-3), ("damping_ratio", 0.04), ("stiffness", 0.01)):
        width = getattr(table, f"{name}_upper") - getattr(table, f"{name}_lower")
        assert np.all(width < most * getattr(table, name)), name


def test_a_mass_that_neglected_harmonics_raise_is_contradicted_by_that_of_the_law() -> None:
    law, values = "k*x + ks*Max(x - b, 0) + c*v", {"k": 14000.0, "ks": 26000.0, "b": 4e-4, "c": 5.0}
    test = fundamentals(simulated(law, values, [1, 2, 4], (13, 23.75, 44), 1.2, noise_relative=0.004))
    found = rsgen.identify(test, law)
    table = rsgen.modal_table(test)
    (said,) = other_mass(table, found)
    assert said["ratio"] == pytest.approx(table.mass / found["m"].value)
    assert said["ratio"] > 1.02
    assert said in tabulate_mode(test, found).table.findings
    linear = noisy(SURFACE, 0.003, 1)
    assert other_mass(rsgen.modal_table(linear), rsgen.identify(linear, "k*x + kn*x**3 + c*v")) == []


def hardening_sweep(step: float, noise: float) -> ResponseSurface:
    """Sweeps upwards whose band ends below the resonance of the highest level: it has points on one side."""
    law = "k*x + k3*x**3 + c*v + Ff*sign(v) + d*v*abs(v)"
    values = {"k": 105e3, "k3": 6e9, "c": 12.0, "Ff": 1.2, "d": 2.0}
    how = {"sweep": "up", "noise_relative": noise, "seed": 1, "method": "harmonic-balance", "harmonics": 3}
    count = round(20.7 / step) + 1
    return simulated(law, values, [4.0, 10.0, 20.0, 35.0], (24.0, 44.7, count), 3.4, **how)


def test_a_gap_of_a_level_held_out_has_no_rows_and_intervals_that_contain_what_the_level_says():
    test = hardening_sweep(0.15, 1e-4)
    whole = rsgen.modal_table(test, mass=3.4)
    table = rsgen.modal_table(test, Observation(hold_out=[20.0]), mass=3.4)
    hole = only(table, "modal-hole")
    assert (hole.severity, "by" in hole.names, "modal-hole" in codes(whole)) == ("warning", False, False)
    rows, low, high = table.amplitude, hole["low"], hole["high"]
    assert not np.any((rows > low) & (rows < high))
    assert {low, high} <= {*rows}
    assert rows[-1] == pytest.approx(table.tested[1])
    between = np.geomspace(low, rows[-1], 12)
    for name in ("frequency", "damping"):
        assert inside(table.at(between), name, getattr(whole.at(between), name)).all()


def test_orders_of_damping_that_points_on_one_side_of_resonance_do_not_tell_apart_are_no_sum():
    test = hardening_sweep(0.3, 2e-4)
    row = rsgen.modal_table(test, Observation(hold_out=[20.0]), mass=3.4)
    assert row.damping[-1] == pytest.approx(rsgen.modal_table(test, mass=3.4).damping[-1], rel=0.05)
    assert row.damping_upper[-1] - row.damping[-1] < 2.0
