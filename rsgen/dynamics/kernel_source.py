"""A force law in normal form becomes Python source that numba compiles: the integrator of this one law.

    x' = v,    m v' = Re F exp(i omega t) - n(x, v, z),    z' = g(x, v, z)

Method: the classical fourth-order one of Runge and Kutta with a fixed number of steps a period (Hairer,
Norsett and Wanner, Solving Ordinary Differential Equations I, 1993, Sec. II.1). It keeps its order on smooth
pieces only, so a step in which a switch of the law changes its sign is repeated piece by piece, from event to
event (ibid., Sec. II.6); dry friction may hold the mass until the applied force exceeds it.

The memory of a law is split off, the rest put into normal form at the signs and order of the values. Where it
jumps or has a corner are switches; a law of Masing type adds v = 0 and where its loop ends. Each piece
becomes source, common parts once, powers as products. Equal normal forms give equal source, so one kernel.

The source is the template ``templates/kernel/kernel.py.j2``, with ``events.py.j2`` and ``together.py.j2`` for
laws with switches, ``reversals.py.j2`` and ``in_turn.py.j2`` for laws of Masing type. What this module writes
into it refers to variables of the template:

    x, v, a         displacement, velocity, acceleration; xn, vn: at the end of the step
    p0, p1, ...     parameters, in ``parameter_order``
    g0, g1, ...     1 where the function of a located switch is positive, else 0
    z0, z1, ...     states with equations; zn0: at the end of the step; b0: their rates
    m0, zm0, s0     force of a law of Masing type; the same within the step; a part that expressions share
    q, past         distance from the last reversal, on a virgin curve; up to where its corners are behind
    lane            a test point: tables have a row a number, and a column a point
    xr, nr0, sw, iw, lim, corner
                    last reversal, force there, w times the direction of the motion, 1/w (w = 1 on the virgin
                    curve, else 2), where the loop closes, the next corner: force = nr0 + sw n(|x - xr| iw)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import jinja2
import sympy
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.pycode import PythonCodePrinter

from rsgen.common.errors import ExpressionError
from rsgen.formula.names import symbol
from rsgen.formula.printing import write
from rsgen.law.character import onset
from rsgen.law.memory import MemoryForm, memory_form, real_powers
from rsgen.law.normal_form import NormalForm, Piece, Switch, normal_form, normal_form_at

# ----------------------------------------------------------------------------
# What a kernel hands over from one call to the next for a law with memory: the rows of its states.

DEEPEST = 16
"""Reversals on the stack of a Masing law. When it is full, the pair next to the outermost reversal goes:
a transient has decayed for eight periods without closing a loop then, and the outermost reversal leads back
to the virgin curve."""

NOTHING, ALONE, EVERYTHING, WITHIN = 0.0, 1.0, 2.0, 3.0
"""Kinds of memory of a Masing law at the start: none, a closed loop and nothing else, all its rows, a
closed loop from which a larger motion leads to the virgin curve around its middle."""


@dataclass(frozen=True, slots=True)
class MemoryRows:
    """Which row is what: x and v/omega, ``states`` with equations, then those of ``curves`` Masing laws.

    The loop of a Masing law, its largest and smallest displacement, are numbers on which the motion depends
    smoothly, as on the states; the other rows are only carried along.
    """

    states: int
    curves: int

    @property
    def first(self) -> int:
        """The first row of the Masing laws: the largest displacement of the loop."""
        return 2 + self.states

    @property
    def smooth(self) -> int:
        """D, the rows on which the motion depends smoothly: they come first."""
        return self.first + (2 if self.curves else 0)

    @property
    def names(self) -> list[str]:
        """The content of each row from ``first`` on, as the kernel names it; then the stack."""
        if not self.curves:
            return []
        forces = range(self.curves)
        return [
            "XT", "XB", "KIND", *(f"OFFSET + {c}" for c in forces), "CENTER", "SW", "IW", "XR", "XP",
            *(f"NR + {c}" for c in forces), "DEPTH", "TURNS",
        ]  # fmt: skip

    def row(self, name: str) -> int:
        """The row of a name; that of the first curve where each has one."""
        return self.first + self.names.index(name)

    @property
    def stack(self) -> int:
        """The first row of the stack: displacements, then the forces of each curve, DEEPEST rows each."""
        return self.first + len(self.names)

    @property
    def count(self) -> int:
        """R, all rows."""
        return self.stack + (DEEPEST * (1 + self.curves) if self.curves else 0)


# ----------------------------------------------------------------------------
# SymPy expressions as plain arithmetic in Python source; numba makes products of whole powers.

_FUNCTIONS = (
    sympy.sin, sympy.cos, sympy.tan, sympy.sinh, sympy.cosh, sympy.tanh, sympy.exp, sympy.log,
    sympy.asin, sympy.acos, sympy.atan, sympy.atan2, sympy.Abs, sympy.sign, sympy.Heaviside, sympy.Piecewise,
)  # fmt: skip


class Source(PythonCodePrinter):  # type: ignore[misc]
    """Writes expressions; every name in them is made by rsgen. SymPy finds the methods by these names."""

    def __init__(self, names: Mapping[sympy.Symbol, str]) -> None:
        super().__init__()
        self.names = dict(names)

    def write(self, expression: sympy.Expr) -> str:
        """Write an expression, in parentheses where it is more than a name, a number or a call."""
        for part in expression.atoms(sympy.Function):
            if part.func not in _FUNCTIONS:
                raise ExpressionError(
                    f"{expression}: {part.func.__name__} has no place in a force law; allowed: "
                    f"{', '.join(sorted(f.__name__ for f in _FUNCTIONS))}, Max, Min"
                )
        return str(self.parenthesize(expression, PRECEDENCE["Atom"], strict=True))

    def _print_Symbol(self, symbol: sympy.Symbol) -> str:  # noqa: N802
        return str(self.names[symbol])

    _print_Dummy = _print_Symbol

    def _print_Number(self, number: sympy.Number) -> str:  # noqa: N802
        return repr(float(number))

    _print_Integer = _print_Rational = _print_Float = _print_Number

    def _print_Pow(self, power: sympy.Pow, rational: bool = False) -> str:  # noqa: N802
        """Write a power; roots of what is negative by round-off are zero."""
        base, exponent = self.write(power.base), power.exp
        half = exponent - sympy.S.Half
        if exponent.is_Integer:
            return f"(1.0/{base}**{-exponent})" if exponent < 0 else f"({base}**{exponent})"
        root = f"math.sqrt(max({base}, 0.0))"
        if half.is_Integer and half >= 0:
            return f"({base}**{half}*{root})" if half else root
        return f"(max({base}, 0.0)**{self.write(exponent)})"

    def _print_sign(self, sign: sympy.sign) -> str:
        code = self.write(sign.args[0])
        return f"(1.0 if {code} > 0.0 else (-1.0 if {code} < 0.0 else 0.0))"

    def _print_Heaviside(self, step: sympy.Heaviside) -> str:  # noqa: N802
        return f"(1.0 if {self.write(step.args[0])} > 0.0 else 0.0)"

    def _print_Piecewise(self, cases: sympy.Piecewise) -> str:  # noqa: N802
        text = "math.nan"
        for value, condition in reversed(cases.args):
            code = self.write(value)
            text = code if condition == sympy.true else f"({code} if {self._print(condition)} else {text})"
        return text


_TEMPLATE = "kernel/kernel.py.j2"

_FIXED_ROWS, _EVENT_ROWS, _CURVE_ROWS, _LOOSE_ROWS = 9, 4, 12, 9
"""Rows of the lane table: of every law, of those with events, of Masing laws, and of these without their
stack: as many as the template names."""

_MAX_COARSE_CORNERS = 4
"""Of virgin curves: of more each is slight, and every coarse step would meet several."""

NO_SIMULATION = (
    "structural(h) exists under periodic motion only: it cannot be simulated in time; identify it, or "
    'simulate by method "harmonic-balance"'
)
"""Why a law with structural damping has no kernel."""

_OF_STATES = {"zs": "z", "zn": "zn", "zm": "zm", "bs": "b"}
"""Lists of arguments in the template: values of the states, at the end of a step and within it, and their
rates. Other lists are ``arguments`` (parameters), ``gates``, and ``masing``, or ``lane_masing`` from a lane's
rows, of Masing laws."""


@dataclass(frozen=True, slots=True)
class _Located:
    """A switch whose zeros the kernel locates, as the template writes it."""

    index: int
    text: str
    code: str
    code_new: str
    rate_code: str
    threshold: str = "0.0"
    jumps: bool = False
    holds_still: bool = False
    kind: str = "plain"

    @property
    def rests(self) -> bool:
        """Dry friction that holds the mass at rest by a bound that stays, against nothing that moves."""
        return self.jumps and self.threshold == "0.0" and self.holds_still


@dataclass(frozen=True, slots=True)
class _Body:
    """The rate of a state with an equation, or the force of a Masing law, as the template writes it."""

    index: int
    name: str
    text: str
    body: list[str]


def parameter_order(force: sympy.Expr) -> tuple[str, ...]:
    """Names of the parameters in the order in which the kernel takes their values."""
    return tuple(sorted({free.name for free in force.free_symbols} - {"x", "v"}))


def _onsets(form: NormalForm, switch: Switch) -> tuple[bool, bool]:
    """Decide whether the law may jump at a switch, and whether it may have a corner there."""
    found = [onset(piece, switch) for piece in form.pieces if switch in piece.switches]
    if not found:
        return False, False
    jumps, corners = zip(*found, strict=True)
    # what an unknown exponent decides is taken for a jump and a corner
    return any(jump is not False for jump in jumps), any(corner is not False for corner in corners)


def _located(
    forms: Sequence[NormalForm],
    names: dict[sympy.Symbol, str],
    states: Sequence[sympy.Symbol],
    every: bool,
    still: bool,
) -> dict[Switch, _Located]:
    """Find the switches whose zeros are located; ``forms`` are those of the force and of the equations."""
    x, v, a = symbol("x"), symbol("v"), sympy.Dummy("a", real=True)
    rates = {z: sympy.Dummy(f"b{number}", real=True) for number, z in enumerate(states)}
    known = {**names, a: "a", **{rate: rate.name for rate in rates.values()}}
    switches = dict.fromkeys(switch for form in forms for piece in form.pieces for switch in piece.switches)
    found: dict[Switch, _Located] = {}
    for switch in switches:
        onsets = [_onsets(form, switch) for form in forms]
        if not (every or any(jumps or corners for jumps, corners in onsets)):
            continue
        moving = [(x, v), (v, a), *rates.items()]
        rate = sympy.Add(*(sympy.diff(switch.function, place) * speed for place, speed in moving))

        def code(expression: sympy.Expr, after: str = "") -> str:
            places = {z: f"z{after}{number}" for number, z in enumerate(states)}
            return Source({**known, x: f"x{after}", v: f"v{after}", **places}).write(expression)

        found[switch] = _Located(
            index=len(found),
            text=write(switch.function),
            code=code(switch.function),
            code_new=code(switch.function, "n"),
            rate_code=code(rate),
            threshold=code(switch.threshold) if switch.threshold is not None else "0.0",
            # only the force itself can hold the mass
            jumps=onsets[0][0] and switch.variable == "v",
            holds_still=still,
        )
    return found


def _turning(located: list[_Located], corners: bool) -> tuple[int, int]:
    """Add what Masing laws locate, the end of a loop and corners, and v = 0 where it is missing.

    The numbers of v = 0 and of the end of a loop; that of corners comes next.
    """
    turns = [entry.index for entry in located if entry.code == "v"]
    if not turns:
        located.append(_Located(len(located), "v", "v", "vn", "a", kind="turn"))
        turns = [len(located) - 1]
    close = len(located)
    code, after, rate = "(lim - x)*sw", "(lim - xn)*sw", "(-v)*sw"
    located.append(_Located(close, "end of the loop", code, after, rate, kind="close"))
    if corners:
        code, after = "corner - abs(x - xr)*iw", "corner - abs(xn - xr)*iw"
        # w times the direction over w squared: the direction over w
        rate = "(-v)*sw*iw*iw"
        located.append(_Located(close + 1, "before a corner", code, after, rate, kind="corner"))
    return turns[0], close


def _corners(forms: Sequence[NormalForm], every: bool) -> tuple[sympy.Expr, ...]:
    """Where virgin curves have corners that are located, as distances from the last reversal."""
    places = dict.fromkeys(
        switch.threshold
        for form in forms
        for switch in dict.fromkeys(switch for piece in form.pieces for switch in piece.switches)
        if switch.variable == "x" and (every or any(_onsets(form, switch)))
    )
    return tuple(places)


def _gate(piece: Piece, located: Mapping[Switch, _Located], body: Source) -> tuple[list[str], list[str]]:
    """Return the conditions of a piece: gates of located switches, and comparisons for the others."""
    gates = [f"g{located[s].index}" for s in piece.switches if s in located]
    inside = [f"({body.write(s.function)} > 0.0)" for s in piece.switches if s not in located]
    return gates, inside


def _past(piece: Piece, places: Sequence[sympy.Expr], body: Source) -> list[str]:
    """Say where a piece of a virgin curve acts: beyond corners that are past, or others as it is there."""
    return [
        f"(past >= {body.write(s.threshold)})"
        if s.threshold in places
        else f"({body.write(s.function)} > 0.0)"
        for s in piece.switches
    ]


def _force_body(
    form: NormalForm,
    names: dict[sympy.Symbol, str],
    located: Mapping[Switch, _Located],
    corners: Sequence[sympy.Expr] | None = None,
) -> list[str]:
    """Write the sum of all pieces; ``corners`` are the located ones of a virgin curve."""
    x, v = symbol("x"), symbol("v")
    body = Source({x: "x", v: "v", **names})
    terms = [_factored(piece.term, x, v) for piece in form.pieces]
    shared, terms = sympy.cse(terms, symbols=sympy.numbered_symbols("s", real=True), order="canonical")
    lines = []
    for number, (stand_in, expression) in enumerate(shared):
        lines.append(f"s{number} = {body.write(expression)}")
        body.names[stand_in] = f"s{number}"
    parts = []
    for piece, term in zip(form.pieces, terms, strict=True):
        code = body.write(term)
        gates, inside = _gate(piece, located, body) if corners is None else ([], _past(piece, corners, body))
        if inside:
            code = f"({code} if {' & '.join(inside)} else 0.0)"
        parts.append("*".join([*gates, code]))
    return [*lines, "return " + (" + ".join(parts) or "0.0")]


def _factored(term: sympy.Expr, x: sympy.Symbol, v: sympy.Symbol) -> sympy.Expr:
    """Write polynomials in x and v with one product a power, parameters gathered."""
    if term.is_polynomial(x, v):
        polynomial = sympy.Poly(term, x, v)
        return sympy.Add(*(c * x**i * v**j for (i, j), c in polynomial.terms()))
    return term


def generate(
    force: sympy.Expr,
    *,
    values: Mapping[str, float] | None = None,
    locate_all: bool = False,
    coarse: bool = False,
) -> str:
    """Write the kernel of a force law as Python source.

    Parameters of the law appear as p0, p1, ... in the order of ``parameter_order``; their own names only
    stand in the text at the top. Laws with a jump or a corner get events, and friction a true stick state;
    smooth laws have none of that code.

    Parameters
    ----------
    force
        n(x, v) [N].
    values
        Of the parameters [SI]. The kernel then holds for values of the same signs and order, and is the same
        for every wording of the law; without, it holds for all values.
    locate_all
        Also locate where only the curvature of the law jumps, as in v|v|: for accuracies beyond 1e-6.
    coarse
        For the way to a steady state only: many corners of a virgin curve are passed without being located.

    Raises
    ------
    ExpressionError
        The law holds a function that no law may use.
    """
    # the normal form of a law with memory is that of ``memory.force``
    memory = memory_form(force)
    if memory is not None and memory.lag is not None:
        raise ExpressionError(NO_SIMULATION)
    rates = () if memory is None else tuple(rate.rate for rate in memory.rates)
    curves = () if memory is None else tuple(real_powers(curve.virgin) for curve in memory.curves)
    forms, virgins = (
        tuple(normal_form(law) if values is None else normal_form_at(law, values) for law in laws)
        for laws in ((force, *rates), curves)
    )
    places = _corners(virgins, locate_all)
    if coarse and len(places) > _MAX_COARSE_CORNERS:
        places = ()
    return _source(forms, virgins, places, memory, parameter_order(force), locate_all)


@lru_cache(maxsize=64)
def _source(
    forms: tuple[NormalForm, ...],
    virgins: tuple[NormalForm, ...],
    places: tuple[sympy.Expr, ...],
    memory: MemoryForm | None,
    order: tuple[str, ...],
    locate_all: bool,
) -> str:
    """Fill the template: bodies of its functions, numbers of rows of its table, lists of arguments.

    Parameters
    ----------
    forms, virgins
        Normal forms of the force and of the rates of its states, and of its virgin curves.
    places
        Corners of virgin curves that are located, as distances from the last reversal.
    memory, order
        What the law remembers, and the names of p0, p1, ...
    locate_all
        As of ``generate``.
    """
    names = {symbol(name): f"p{number}" for number, name in enumerate(order)}
    symbols = [] if memory is None else [rate.symbol for rate in memory.rates]
    masing = [] if memory is None else [curve.symbol for curve in memory.curves]
    plain = _located(forms, names, symbols, locate_all, memory is None)
    located = list(plain.values())
    turn, close = _turning(located, bool(places)) if masing else (-1, -1)
    inside = names | {z: f"z{number}" for number, z in enumerate(symbols)}
    inside |= {z: f"m{number}" for number, z in enumerate(masing)}
    curves = _bodies(masing, virgins, names | {symbol("x"): "q"}, {}, places)
    return _template().render(
        law=_comment(write(forms[0].expression)),
        parameters=[(f"p{number}", name) for number, name in enumerate(order)],
        names=[f"p{number}" for number in range(len(order))],
        arguments=_listed("p", len(order)),
        gates=_listed("g", len(located)),
        located=located,
        force_body=_force_body(forms[0], inside, plain),
        states=_bodies(symbols, forms[1:], inside, plain),
        curves=curves,
        turn=turn,
        close=close,
        corners=[Source(names).write(place) for place in places],
        **_row_numbers(MemoryRows(len(symbols), len(curves)), events=bool(located)),
        **_masing_arguments(len(curves)),
        **{name: _listed(letters, len(symbols)) for name, letters in _OF_STATES.items()},
    )


def _bodies(
    symbols: Sequence[sympy.Symbol],
    forms: Sequence[NormalForm],
    names: dict[sympy.Symbol, str],
    located: Mapping[Switch, _Located],
    corners: Sequence[sympy.Expr] | None = None,
) -> list[_Body]:
    """Write the body of each state or Masing law; see ``_force_body``."""
    return [
        _Body(number, z.name, _comment(write(form.expression)), _force_body(form, names, located, corners))
        for number, (z, form) in enumerate(zip(symbols, forms, strict=True))
    ]


def _row_numbers(rows: MemoryRows, *, events: bool) -> dict[str, Any]:
    """Return where the template finds what: rows of a state, and rows of the lane table."""
    first = _FIXED_ROWS + (_EVENT_ROWS if events else 0)
    first_curve = first + 2 * rows.states
    return {
        "fixed_rows": _FIXED_ROWS,
        "event_rows": _EVENT_ROWS,
        "curve_rows": _CURVE_ROWS,
        "deepest": DEEPEST,
        "kept": rows.names,
        "first_kept": rows.first,
        "size": rows.count,
        "smooth": rows.smooth,
        "first": first,
        "first_curve": first_curve,
        "gate": first_curve + (_CURVE_ROWS + 3 * rows.curves if rows.curves else 0),
        "stack": _LOOSE_ROWS + DEEPEST * (1 + rows.curves) if rows.curves else 0,
    }


def _masing_arguments(count: int) -> dict[str, str]:
    """Return the arguments of Masing laws, by name and from the rows of a lane; "" without such laws."""
    rows = ("XR", "IW", "SW", "LIMIT", "PAST", "CORNER", *(f"NR + {c}" for c in range(count)))
    named = ", xr, iw, sw, lim, past, corner" + _listed("nr", count)
    lane = "".join(f", lane[{row}, i]" for row in rows)
    return {"masing": named if count else "", "lane_masing": lane if count else ""}


@cache
def _template() -> jinja2.Template:
    """Load the template of a kernel's source."""
    environment = jinja2.Environment(  # noqa: S701  (Python source, not HTML: nothing to escape)
        loader=jinja2.FileSystemLoader(Path(__file__).parents[1] / "templates"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template(_TEMPLATE)


def _listed(letters: str, count: int) -> str:
    """Arguments of a function after others."""
    return "".join(f", {letters}{number}" for number in range(count))


def _comment(text: str) -> str:
    """Let a formula stand in a docstring: the writer's alphabet, nothing that could end it."""
    allowed = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_+-*/().,<>=&| ")
    return "".join(c if c in allowed else "?" for c in text)
