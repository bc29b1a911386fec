"""Generated kernels: their force is the law, their names are rsgen's own."""

import ast
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rsgen.common.errors import RsgenError
from rsgen.dynamics.kernel import compile_kernel, load_kernel
from rsgen.dynamics.kernel_source import generate, parameter_order
from rsgen.formula.names import symbol
from rsgen.formula.reading import parse
from rsgen.law.normal_form import normal_form

# the same arithmetic in another order
ROUNDING = 1e-12

LAWS = [
    "c*v + k*x + kn*x**5", "c*v + k*x + F_f*sign(v)", "k*x + cx*x*abs(x)*v*abs(v)",
    "c*v + Piecewise((k4*x, abs(x) <= b), (k5*x + (k4 - k5)*b*sign(x), True))",
    "c*v + Piecewise((k6*x, x > 0), (k7*x, True))", "k*x + (F_f + mu*x**2)*sign(v)",
    "k*Max(x - g, 0)**1.5 + c*v", "k*abs(x)**1.5*sign(x) + c*v", "k*tanh(x/d) + c*v/(1 + abs(x)/d)",
    "k*sin(x/d) + a*sign(x + d*v)", "k*exp(x/d)*x + F_f*sign(v - w)",
]  # fmt: skip


def _plain_force(source: str) -> Callable[..., float]:
    """The force of a kernel as plain Python: compilation is tested by the motions."""
    tree = ast.parse(source)
    (force,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "force")
    force.decorator_list = []
    text = source[: source.index("\n@njit(")].replace("from numba import carray, cfunc, njit, types", "")
    space: dict[str, Any] = {}
    exec(compile(f"{text}\n{ast.unparse(force)}", "kernel", "exec"), space)
    return space["force"]


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("every", [False, True], ids=["events where needed", "events everywhere"])
def test_force_of_the_kernel_is_the_force_of_the_law(law, every):
    force = parse(law)
    names = parameter_order(force)
    random = np.random.default_rng(7)
    values = {symbol(name): float(random.uniform(0.2, 2.0)) for name in names}
    source = generate(force, locate_all=every)
    plain = _plain_force(source)
    # the gates, read from the comments of the kernel itself
    lines = [line for line in source.splitlines() if line.startswith("# gate ")]
    switches = [parse(line.split(": ", 1)[1].split(" > 0")[0]) for line in lines]
    for _ in range(12):
        x, v = random.uniform(-2, 2, 2)
        point = values | {symbol("x"): x, symbol("v"): v}
        gates = [float(float(switch.subs(point)) > 0) for switch in switches]
        expected = float(force.subs(point))
        assert plain(x, v, *gates, *values.values()) == pytest.approx(expected, rel=ROUNDING, abs=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_names_of_the_user_never_reach_the_code(law):
    force = parse(law)
    telltale = {symbol(name): symbol(f"user_{name}") for name in parameter_order(force)}
    tree = ast.parse(generate(force.xreplace(telltale)))
    tree.body = tree.body[1:]  # the docstring lists them
    assert "user_" not in ast.dump(tree)


def test_several_friction_terms_share_one_switch():
    assert len(normal_form(parse("F_f*sign(v) + mu*x**2*sign(v) + k*x")).switches) == 1


def test_machine_code_never_relies_on_what_is_not_so():
    kernel = compile_kernel(parse("c*v + k*x"))
    good = {
        "points": np.arange(3), "state": np.zeros((2, 3)), "force": np.zeros((3, 2)), "omega": np.ones(3),
        "mass": 1.0, "values": np.ones(2),
    }  # fmt: skip
    bad = {
        "points": [np.arange(4), np.array([0, 1, 3]), np.array([0, -1, 2])],
        "state": [np.zeros((3, 2)), np.zeros((2, 4))],
        "force": [np.zeros((2, 3)), np.zeros((3, 2), np.float32)],
        "omega": [np.ones(2)],
        "values": [np.ones(3), np.ones(2, np.int64)],
    }
    assert kernel.integrate(**good, steps=16, periods=1).state.shape == (2, 3)
    for name, faults in bad.items():
        for fault in faults:
            with pytest.raises(RsgenError, match="integrate"):
                kernel.integrate(**(good | {name: fault}), steps=16, periods=1)


@pytest.mark.thorough
def test_numba_is_left_as_it_was(tmp_path, monkeypatch):
    monkeypatch.setenv("RSGEN_CACHE", str(tmp_path))
    numba = pytest.importorskip("numba")
    before = numba.njit(lambda a: a + 1)
    assert before(1) == 2
    load_kernel(generate(parse("c*v + k*x")) + "\n# a kernel among others\n")
    assert before(1.5) == 2.5
    assert numba.njit(lambda a: a * before(a))(2.0) == 6.0
    assert numba.config.OPT == 3


@pytest.mark.slow
def test_every_function_of_a_law_is_there_without_the_compiler():
    law = (
        "c*v + sin(x)*cos(x) + tan(x) + sinh(x) + cosh(x)*tanh(x) + exp(x) + log(2 + x) + asin(x/9)"
        " + acos(x/9) + atan(x) + atan2(x, v) + abs(x)**1.3 + sqrt(abs(x)) + Max(x, v)*Min(x, 2) + sign(x)"
    )
    kernel = compile_kernel(parse(law))
    moved = kernel.integrate(
        np.arange(2), np.full((2, 2), 0.1), np.ones((2, 2)), np.array([3.0, 4.0]), 1.0, np.array([0.5]),
        steps=64, periods=2,
    )  # fmt: skip
    assert np.isfinite(moved.state).all()


def test_state_does_not_depend_on_the_company_in_the_lanes():
    kernel = compile_kernel(parse("c*v + k*x + F_f*sign(v)"))
    values = np.array([0.5, 0.8, 40.0])
    omega = np.linspace(4, 9, 150)
    force = np.tile([2.0, 0.5], (150, 1))

    def state(points: np.ndarray) -> np.ndarray:
        rest = np.zeros((2, len(points)))
        return kernel.integrate(points, rest, force, omega, 1.0, values, steps=48, periods=9).state

    together = state(np.arange(150))
    for i in (0, 71, 149):
        assert np.array_equal(state(np.array([i]))[:, 0], together[:, i])


def test_peaks_between_two_steps_are_those_of_the_sine():
    # free vibration of unit amplitude, 16 steps a period: h^6/9 is lost to damping of the method, h^4/384
    # to the cubic between two steps
    kernel, phase = compile_kernel(parse("k*x")), np.linspace(0, 2 * np.pi, 40)
    moved = kernel.integrate(
        np.arange(40), np.array([np.cos(phase), -np.sin(phase)]), np.zeros((40, 2)), np.ones(40), 1.0,
        np.ones(1), steps=16, periods=1, harmonics=1,
    )  # fmt: skip
    assert np.abs(moved.peak - [1.0, -1.0]).max() < 1e-3


def test_friction_holds_a_mass_where_its_spring_has_left_it():
    # a slow force of 0.7 cos(t) N on k x0 = 0.6 N: it lets go below 0.6 - 1 N, slides to k x = 1 - 0.7 N, and
    # stays there; viscous lag is second order where the force turns
    kernel = compile_kernel(parse("c*v + k*x + F_f*sign(v)"))
    moved = kernel.integrate(
        np.array([0]), np.array([[0.6], [0.0]]), np.array([[0.7, 0.0]]), np.array([0.01]), 1.0,
        np.array([1.0, 2.0, 1.0]), steps=2000, periods=1,
    )  # fmt: skip
    assert moved.state[:, 0] == pytest.approx([0.3, 0.0], abs=1e-3)
