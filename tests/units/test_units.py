"""Units: exact values in SI, dimensions that are checked, and the units that a force law demands."""

import math

import pint
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rsgen.common.errors import RsgenError
from rsgen.formula import unit_text
from rsgen.formula.reading import parse
from rsgen.formula.unit_deduction import parameter_units, unit_faults
from rsgen.formula.unit_text import read_unit
from rsgen.formula.units import quantity, sensor_factor, sensor_unit

LAST_DIGITS = 4e-16  # of a double: two roundings


@pytest.mark.parametrize(("text", "unit", "value"), [
    ("5.92 kN/m", "N/m", 5920.0), ("-2.2e5 N/m^3", "N/m**3", -2.2e5), ("3.8 N s/m", "N*s/m", 3.8),
    ("1.2 N·s²/m²", "N*s^2/m^2", 1.2), ("20mm", "m", 0.02), ("3 µm", "m", 3e-6), ("6200 g", "kg", 6.2),
    ("0.05 kHz", "Hz", 50.0), ("314 rad/s", "1/s", 314.0),
    ("30 rpm", "rad/s", math.pi), ("90 deg", "1", math.pi / 2), ("5 %", "1", 0.05),
    ("1 lbf", "N", 4.4482216152605),  # exact by definition of pound and standard gravity
    ("1 lbf/inch", "N/m", 4.4482216152605 / 0.0254), ("2 N/(m/s)^1.5", "N*s^1.5/m^1.5", 2.0),
    ("2 N/mm^(1/2)", "N/m^0.5", 2 / math.sqrt(1e-3)), ("10 mV/N", None, 0.01), ("0 N", "N", 0.0),
    ("-0.0 N", "N", 0.0), (5920, "N/m", 5920.0), (0.1, None, 0.1), (-0.0, "m", 0.0),
])  # fmt: skip
def test_a_quantity_is_its_si_value(text, unit, value):
    found = quantity(text, unit)
    assert found == pytest.approx(value, rel=LAST_DIGITS, abs=0)
    assert math.copysign(1, found) == math.copysign(1, value)


@pytest.mark.parametrize(("value", "unit", "said"), [
    ("5.92 kN", "N/m", "'5.92 kN' is a force, but N/m (a stiffness) is needed"),
    ("0.6 V", "N", "'0.6 V' is in V, but N (a force) is needed"),
    ("50 Hz", "rad/s", "counts cycles, but rad/s is needed; a cycle is 2 pi rad: write 314.159 rad/s"),
    ("50 rad/s", "Hz", "is an angular frequency, but Hz is needed"),
    ("5 m", "1", "is a length, but a plain number without unit is needed"),
    ("1.0", "N", "a number in quotes; write \"1.0 N\", or 1.0 without quotes, in N"),
    ("", "N", "is not a number with a unit"), ("N", "N", "is not a number with a unit"),
    ("5,92 kN", "N", "write a decimal point"), ("5 kn/m", "N/m", "N/m (a stiffness) is needed"),
    ("5 Nm", "N", "the unit 'Nm' is not known, did you mean 'N*m'?"),
    ("2.7 N rms", "N", "'2.7 N rms' is a root mean square; write the peak value '3.818 N'"),
    ("2 Vrms", "N", "peak value '2.828 V', or leave rms out"), ("1e999 N rms", "N", "out of range"),
    ("22.5 mv/N", None, "'mv' is not known, did you mean 'mV'?"), ("5 n", "N", "did you mean 'N'?"),
    ("5 kn", "N", "'5 kn' is a velocity, but N (a force) is needed; did you mean 'kN'?"),
    ("20 degC", None, "has an offset or is logarithmic"),
    ("3 dB", None, "has an offset or is logarithmic"), ("1 N/m s", None, "ambiguous after its '/'"),
    ("2*3 N", "N", "is not a unit"), ("1 N^(1/0)", None, "no number as a power"),
    ("1 N^21", None, "a power above 20"), ("1 ((((((((N))))))))", "N", "too many parentheses"),
    ("1 ((((%^20)^20)^20)^20)", None, "out of range"), ("1 __import__('os')", "N", "is not a unit"),
    ("1e-400 N", "N", "out of range"), ("1" * 500 + " N", "N", "has 502 characters"),
    (math.inf, "N", "out of range"), (math.nan, "N", "out of range"), (10**400, "N", "out of range"),
    (1e-320, "N", "out of range"), (True, "N", "is not a number"), (None, "N", "is not a number"),
    ("5 \ud800", "N", "is not a unit"), ("\x1b[2J N", "N", "is not a number with a unit"),
])  # fmt: skip
def test_a_wrong_quantity_is_refused_in_a_sentence(value, unit, said):
    with pytest.raises(RsgenError) as caught:
        quantity(value, unit)
    message = str(caught.value)
    assert said in message
    assert (message.isascii(), message.isprintable()) == (True, True)


PIECES = (
    "1", "N", "kN", "m", "s", "Hz", "rad", "%", "mm", "/", "*", "^", "**", "(", ")", "2", "-1", "0.5",
    "(1/2)", "·", "²", "e5", "1e9", "k", "_", "'", ".", ",", " ",
)  # fmt: skip


@pytest.mark.slow
@given(st.one_of(st.text(max_size=30), st.lists(st.sampled_from(PIECES), max_size=12).map("".join)))
@example("1" + " N" * 20)
def test_whatever_the_text_only_an_rsgen_error_comes_out(text):
    for value in (text, f"1 {text}"):
        try:
            assert math.isfinite(quantity(value))
        except RsgenError as error:
            said = str(error)
            assert said.isprintable()


@pytest.mark.parametrize(("law", "units"), [
    ("c1*v + k1*x + kn1*x**3", {"c1": "N*s/m", "k1": "N/m", "kn1": "N/m^3"}),
    ("c3*v + k3*x + Ff*sign(v)", {"c3": "N*s/m", "k3": "N/m", "Ff": "N"}),
    ("Piecewise((k4*x, abs(x) <= b), (k5*x + k4*b*sign(x), True))", {"k4": "N/m", "k5": "N/m", "b": "m"}),
    # numbers before x are values with a unit where the rest asks for one
    ("k*x + masing(Min(1500*x, F1))", {"k": "N/m", "F1": "N"}), ("Max(-Fm, Min(20*x, Fm))", {"Fm": "N"}),
    ("masing(Piecewise((1500*x - (1500*x)**2/(4*Fs), 1500*x < 2*Fs), (Fs, True)))", {"Fs": "N"}),
    ("k*Max(0, 2*x - b)", {"k": "N/m", "b": "m"}), ("A*tanh(1000*v/w)", {"A": "N", "w": "m/s"}),
    ("cn6*v*abs(v) + kn8*x**3", {"cn6": "N*s^2/m^2", "kn8": "N/m^3"}),
    ("(Fs + (Fc - Fs)*exp(-(v/vs)**2))*sign(v)", {"Fs": "N", "Fc": "N", "vs": "m/s"}),
    ("k*x*Heaviside(x - b)", {"k": "N/m", "b": "m"}), ("mu*(x**2 - a)*v", {"mu": "N*s/m^3", "a": "m^2"}),
    ("7.244e5*x + k*x**3", {"k": "N/m^3"}), ("F0*sin(q*x)", {"F0": "N", "q": "1/m"}),
    ("c*abs(v/v0)**p*sign(v)", {"c": "N", "v0": "m/s", "p": "1"}),
    ("c*abs(v)**p*sign(v)", {"c": "", "p": "1"}), ("a*b*x", {"a": "", "b": ""}), ("P", {"P": "N"}),
    ("100*x", {}), ("0", {}),
])  # fmt: skip
def test_units_follow_from_the_law(law, units):
    assert parameter_units(parse(law)) == dict(sorted(units.items()))


@pytest.mark.parametrize(("law", "units", "faults"), [
    ("kn1*x**3", {"kn1": "N/m^2"}, ("kn1*x**3 is in N*m, a force is needed: kn1 must be in N/m^3",)),
    ("k*x", {"k": "kN/mm"}, ()), ("masing(Min(1500*x, F1))", {"F1": "kN"}, ()),
    ("masing(Min(1500*x, F1))", {"F1": "mm"}, ("masing(Min(F1, 1500*x)) is in m, a force is needed",)),
    ("k*x + c*v", {"k": "N", "c": "N*m"}, (
        "c*v is in N*m^2/s, a force is needed: c must be in N*s/m",
        "k*x is in N*m, a force is needed: k must be in N/m",
    )),
    ("F0*tanh(v/v0)", {"v0": "m"}, ("v/v0 is in 1/s, a plain number is needed in tanh: v0 must be in m/s",)),
])  # fmt: skip
def test_declared_units_are_checked_term_by_term(law, units, faults):
    assert unit_faults(parse(law), units) == faults


def test_a_parameter_with_two_units_is_a_fault():
    with pytest.raises(RsgenError, match=r"k\*[xv] is in .*: k must be in N.* elsewhere in N"):
        parameter_units(parse("k*x + k*v"))
    with pytest.raises(RsgenError, match="b must be in m"):
        parameter_units(parse("k*Max(x - b, 0) + c*Max(v - b, 0)"))


@given(st.integers(0, 5), st.integers(0, 5), st.fractions(0, 3, max_denominator=4))
def test_a_power_law_has_the_unit_that_makes_it_a_force(i, j, q):
    units = parameter_units(parse(f"a*x**{i}*v**{j}*abs(x)**({q})"))
    dimension = read_unit(units["a"]).dimension * read_unit("m").dimension ** (i + q)
    assert dimension * read_unit("m/s").dimension ** j == read_unit("N").dimension


@pytest.mark.parametrize(("text", "unit", "target", "value"), [
    ("20 g/V", "V", "m/s^2", 20 * 9.80665), ("20 g/V", "mV", "m/s^2", 0.02 * 9.80665),
    ("50 mm/s/V", "V", "m/s", 0.05), ("3 N/V", "V", "N", 3.0),
    # what the sheet of a sensor says: volts a unit
    ("100 mV/g", "V", "m/s^2", 98.0665), ("-100 mV/g", "V", "m/s^2", -98.0665),
    ("8 mV/um", "V", "m", 125e-6), ("22.4 mV/N", "mV", "N", 1 / 22.4),
    # among masses g is the gram, among accelerations the gravity
    ("500 g", "m/s^2", "N", 0.5), ("-2 kg", "g", "N", -2 * 9.80665), ("2", "g", "m/s^2", None),
    ("20 g/A", "V", "m/s^2", None),
])  # fmt: skip
def test_the_factor_of_a_sensor(text, unit, target, value):
    if value is None:
        with pytest.raises(RsgenError, match=r"^(?!.*standard_gravity)"):
            sensor_factor(text, unit, target)
    else:
        assert sensor_factor(text, unit, target) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("unit", ["g", "gn", "1000 mg", "9.80665 m/s2", "9.80665 m/s²", "9.80665 m/sec^2"])
def test_units_of_accelerations(unit):
    number, _, name = unit.rpartition(" ")
    value = float(number or 1) * quantity(f"1 {sensor_unit(name, 'm/s^2')}", "m/s^2")
    assert value == pytest.approx(9.80665, rel=1e-14)


@pytest.mark.slow
def test_names_that_need_no_registry_are_those_of_the_registry(monkeypatch):
    known = dict(unit_text._KNOWN)
    monkeypatch.setattr(unit_text, "_KNOWN", {})
    assert {name: unit_text._named.__wrapped__(name) for name in known} == known
    theirs = pint.get_application_registry()
    for name, unit in known.items():
        there = theirs("percent" if name == "%" else name).to_base_units()
        assert float(unit.factor) == pytest.approx(there.magnitude, rel=1e-15), name
