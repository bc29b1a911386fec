"""Formulas for people: as plain text, as LaTeX, and as MathML for pages that need no network."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar

import nh3
import sympy

from rsgen.formula.printing import Level, Printer, TextPrinter, decimal_text, depends_on_state, split_sum

_GREEK = frozenset({
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu",
    "nu", "xi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta",
    "Lambda", "Xi", "Sigma", "Upsilon", "Phi", "Psi", "Omega", "Pi",
})  # fmt: skip
_LETTERS = re.compile(r"([A-Za-z]+)([0-9]*)(.*)")
_LONG_CASE = 250
"""Characters of LaTeX above which cases take a line a term: in one line they are wider than paper."""
_CLOSE = re.compile(r"(\\?[A-Za-z]+(_\{\w+\})?(\^\{\w+\})?|[0-9.]+)$|\\(frac|left|sqrt)")


def _escaped(text: str) -> str:
    """Letters and digits as they are; anything else, which no checked name has, by its code point."""
    return "".join(c if c.isascii() and c.isalnum() else f"U+{ord(c):04X}" for c in text)


class _ReadablePrinter(TextPrinter):
    """Plain text: blanks between factors, ^ for powers, |x|, cases in braces."""

    times = " "
    raised = "^"
    reads_back = False
    relations: ClassVar[dict[type[sympy.Basic], str]] = Printer.relations | {sympy.Eq: "=", sympy.Ne: "!="}

    def call(self, name: str, arguments: Sequence[sympy.Expr]) -> tuple[str, Level]:
        if name == "abs" and not arguments[0].has(sympy.Abs):
            return f"|{self.write(arguments[0])}|", Level.ATOM
        if name in ("besselj", "besseli") and arguments[0].is_Integer:
            return super().call(f"{name[-1].upper()}{arguments[0]}", arguments[1:])
        return super().call(name, arguments)

    def cases(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> tuple[str, Level]:
        return "{" + "; ".join(f"{value} {when}" for value, when in self.rows(branches)) + "}", Level.ATOM

    def rows(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> list[tuple[str, str]]:
        return [
            (self.write(value), "otherwise" if when == sympy.true else f"if {self.condition(when)}")
            for value, when in branches
        ]

    def quotient(self, above: Sequence[sympy.Expr], below: Sequence[sympy.Expr]) -> str:
        integrals, rest = _separate_integrals(above)
        front = [super().quotient(rest, below)] if rest or below or not integrals else []
        return self.times.join([*front, *map(self.write, integrals)])

    def foreign(self, expr: sympy.Basic) -> tuple[str, Level]:
        if _is_condition(expr):
            return self.condition(expr), Level.ANY
        if _is_definite(expr):
            (variable, *limits), inside = expr.limits[0], self.write(expr.function, Level.PRODUCT)
            low, high = (self.write(limit).replace(" ", "") for limit in limits)
            return f"integral_{low}^{high} {inside} d{self.write(variable)}", Level.ATOM
        return str(expr), Level.ATOM if expr.is_Atom or expr.is_Function else Level.ANY


class _LatexPrinter(Printer):
    """LaTeX that KaTeX, MathJax, TeX and latex2mathml read alike."""

    both = r"\text{ and }"
    either = r"\text{ or }"
    relations: ClassVar[dict[type[sympy.Basic], str]] = {
        sympy.Lt: "<", sympy.Le: r"\leq", sympy.Gt: ">", sympy.Ge: r"\geq", sympy.Eq: "=", sympy.Ne: r"\neq",
    }  # fmt: skip
    functions: ClassVar[dict[str, str]] = {
        "sign": r"\operatorname{sgn}", "Heaviside": r"\operatorname{H}", "Min": r"\min", "Max": r"\max",
        "log": r"\ln", "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "gamma": r"\Gamma",
        "masing": r"\operatorname{masing}", "structural": r"\operatorname{structural}",
        "atan2": r"\mathrm{atan2}",
    } | {name: f"\\{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp")}  # fmt: skip

    def name(self, name: str) -> str:
        first, *rest = name.split("_")
        match = _LETTERS.fullmatch(first)
        if match is None:
            return rf"\text{{{_escaped(name)}}}"
        letters, digits, more = match.groups()
        split = len(letters) == 2 or (len(letters) <= 4 and letters[0].isupper() and letters[1:].islower())
        if letters in _GREEK:
            base, subscript = f"\\{letters}", digits + more
        elif len(letters) == 1 or split:
            base, subscript = letters[0], letters[1:] + digits + more
        else:
            base, subscript = rf"\mathrm{{{letters}}}", digits + more
        parts = [part for part in (subscript, *rest) if part]
        if not parts:
            return base
        return f"{base}_{{{','.join(map(self._subscript, parts))}}}"

    @staticmethod
    def _subscript(text: str) -> str:
        plain = _escaped(text)
        if text in _GREEK:
            return f"\\{text}"
        return rf"\mathrm{{{plain}}}" if sum(character.isalpha() for character in text) > 2 else plain

    def constant_pi(self) -> str:
        return r"\pi"

    def number(self, number: sympy.Rational) -> str:
        mantissa, exponent = decimal_text(number) or (str(number), "")
        if not exponent:
            return mantissa
        power = f"10^{{{exponent}}}"
        return power if mantissa == "1" else rf"{mantissa}\times {power}"

    def number_level(self, number: sympy.Rational) -> Level:
        decimal = decimal_text(number)
        return Level.PRODUCT if decimal and decimal[1] else Level.ATOM

    def parenthesised(self, text: str) -> str:
        return rf"\left({text}\right)"

    def juxtaposed(self, pieces: Sequence[str]) -> str:
        text, *rest = pieces
        for before, piece in zip(pieces, rest, strict=False):
            text += (" " if _CLOSE.match(before) and _CLOSE.match(piece) else r"\,") + piece
        return text

    def _factors(self, factors: Sequence[sympy.Expr]) -> str:
        if len(factors) == 1 and not factors[0].is_Rational:
            return self.write(factors[0])
        return self.juxtaposed([self._factor(factor) for factor in factors])

    def quotient(self, above: Sequence[sympy.Expr], below: Sequence[sympy.Expr]) -> str:
        if not below:
            if len(above) == 1 and not above[0].is_Rational:
                return self.write(above[0], Level.POWER)
            return self._factors(above)
        wide = [factor for factor in above if _is_wide(factor)]
        top = [factor for factor in above if factor not in wide]
        fraction = rf"\frac{{{self._factors(top) if top else '1'}}}{{{self._factors(below)}}}"
        return self.juxtaposed([fraction, *(self.write(factor, Level.POWER) for factor in wide)])

    def power(self, base: sympy.Expr, exponent: sympy.Expr) -> tuple[str, Level]:
        if exponent == sympy.S.Half:
            return rf"\sqrt{{{self.write(base)}}}", Level.ATOM
        if exponent.is_Rational and exponent.p == 1 and exponent.q <= 5:
            return rf"\sqrt[{exponent.q}]{{{self.write(base)}}}", Level.ATOM
        raised = _FLAT.write(exponent)
        name = type(base).__name__
        if (
            name in self.functions
            and isinstance(base, sympy.Function)
            and exponent.is_Integer
            and name != "exp"
        ):
            head, _, rest = self.call(name, base.args)[0].partition(r"\left(")
            return rf"{head}^{{{raised}}}\left({rest}", Level.POWER
        return f"{self.write(base, Level.ATOM)}^{{{raised}}}", Level.POWER

    def call(self, name: str, arguments: Sequence[sympy.Expr]) -> tuple[str, Level]:
        if name == "abs":
            return rf"\left|{self.write(arguments[0])}\right|", Level.ATOM
        if name == "exp" and not _is_wide(arguments[0]):
            return rf"\mathrm{{e}}^{{{_FLAT.write(arguments[0])}}}", Level.POWER
        if name in ("besselj", "besseli"):
            head = f"{name[-1].upper()}_{{{self.write(arguments[0])}}}"
            arguments = arguments[1:]
        else:
            head = self.functions[name]
        inside = ", ".join(self.write(argument) for argument in arguments)
        return head + self.parenthesised(inside), Level.ATOM

    def cases(self, branches: Sequence[tuple[sympy.Expr, sympy.Basic]]) -> tuple[str, Level]:
        values = [self.write(value) for value, _ in branches]
        when = [
            r"\text{otherwise}" if condition == sympy.true else rf"\text{{if }} {self.condition(condition)}"
            for _, condition in branches
        ]
        rows = [f"{value} & {condition}" for value, condition in zip(values, when, strict=True)]
        if max(map(len, values)) > _LONG_CASE:
            rows = []
            for (value, _), condition in zip(branches, when, strict=True):
                rows += [rf"{condition}\text{{:}}", *(rf"\quad {term}" for term in self.terms(value))]
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}", Level.ATOM

    def foreign(self, expr: sympy.Basic) -> tuple[str, Level]:
        if _is_condition(expr):
            return self.condition(expr), Level.ANY
        if _is_definite(expr):
            (variable, *limits), inside = expr.limits[0], self.write(expr.function, Level.PRODUCT)
            low, high = map(self.write, limits)
            return rf"\int_{{{low}}}^{{{high}}} {inside}\,\mathrm{{d}}{self.write(variable)}", Level.ATOM
        return str(sympy.latex(expr)), Level.ATOM if expr.is_Atom or expr.is_Function else Level.ANY


class _FlatLatexPrinter(_LatexPrinter):
    """LaTeX for exponents: fractions with a slash."""

    def quotient(self, above: Sequence[sympy.Expr], below: Sequence[sympy.Expr]) -> str:
        if not below:
            return super().quotient(above, below)
        top = self.juxtaposed([self._factor(factor) for factor in above] or ["1"])
        bottom = self.juxtaposed([self._factor(factor) for factor in below])
        return f"{top}/{bottom if len(below) == 1 else self.parenthesised(bottom)}"


def _is_wide(factor: sympy.Expr) -> bool:
    """Decide whether a factor is too wide or too high to stand in a fraction or an exponent."""
    if isinstance(factor, sympy.Piecewise | sympy.Integral):
        return True
    return bool(
        factor.is_Add and depends_on_state(factor) and (len(factor.args) > 2 or factor.has(sympy.Function))
    ) or any(isinstance(part, sympy.Piecewise) for part in factor.args)


def _separate_integrals(factors: Sequence[sympy.Expr]) -> tuple[list[sympy.Expr], list[sympy.Expr]]:
    """Separate integrals, which stand behind a fraction, from all other factors."""
    integrals = [factor for factor in factors if isinstance(factor, sympy.Integral)]
    return integrals, [factor for factor in factors if factor not in integrals]


def _is_condition(expr: sympy.Basic) -> bool:
    return isinstance(expr, sympy.Rel | sympy.And | sympy.Or)


def _is_definite(expr: sympy.Basic) -> bool:
    """Decide whether this is an integral over one variable between limits."""
    return isinstance(expr, sympy.Integral) and [len(limit) for limit in expr.limits] == [3]


_READABLE = _ReadablePrinter()
_LATEX = _LatexPrinter()
_FLAT = _FlatLatexPrinter()


def readable(expr: sympy.Expr) -> str:
    """Write a formula as a person writes it in plain text.

    Parameters
    ----------
    expr
        Any expression, or a condition of cases; an integral over one variable may stand in it.

    Returns
    -------
    str
        Coefficients in front, low degrees first, blanks for products, ^ for powers. A formula in pieces
        takes one line a piece, the lines after the first indented below it.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> print(readable(parse("X**2*kn1*3/4 + k1")))
    k1 + 3/4 kn1 X^2
    >>> print(readable(parse("c*v + Piecewise((k4*x, abs(x) <= b), (k5*x, True))")))
    c v + { k4 x  if |x| <= b
          { k5 x  otherwise
    """
    formula = sympy.sympify(expr, strict=True)
    if not isinstance(formula, sympy.Expr):
        return _READABLE.write(formula)
    terms = sympy.Add.make_args(formula)
    pieces = [term for term in split_sum(formula) if isinstance(term, sympy.Piecewise)]
    if not pieces or any(term.has(sympy.Piecewise) for term in terms if term not in pieces):
        return _READABLE.write(formula)
    rest = sympy.Add(*(term for term in terms if term not in pieces))
    front = f"{_READABLE.write(rest)} + " if rest != 0 else " " * 2 * (len(pieces) > 1)
    blocks = []
    for piece in pieces:
        rows = _READABLE.rows([(pair.expr, pair.cond) for pair in piece.args])
        width = max(len(value) for value, _ in rows)
        lines = [f"{{ {value:<{width}}  {when}" for value, when in rows]
        blocks.append(f"\n{' ' * len(front)}".join(lines))
    return front + f"\n{'+ ':>{len(front)}}".join(blocks)


def latex(expr: sympy.Expr) -> str:
    """Write a formula in LaTeX, names of parameters with subscripts: kn1 as k_{n1}, Ff as F_{f}.

    Parameters
    ----------
    expr
        Any expression.

    Returns
    -------
    str
        LaTeX for mathematics mode.

    Examples
    --------
    >>> from rsgen.formula.reading import parse
    >>> latex(parse("X**2*kn1*3/4 + k1"))
    'k_{1} + \\\\frac{3}{4}\\\\,k_{n1} X^{2}'
    """
    return _LATEX.write(sympy.sympify(expr, strict=True))


_TAGS = {
    "math", "mrow", "mi", "mn", "mo", "mtext", "mspace", "mfrac", "msup", "msub", "msubsup", "msqrt", "mroot",
    "mtable", "mtr", "mtd", "mover", "munder", "munderover",
}  # fmt: skip
_MENDED = [
    (re.compile(pattern), instead)
    for pattern, instead in (
        # MathML Core has no columnalign: browsers centre the cells without a style
        ('<mtd columnalign="left">', '<mtd style="text-align:left">'),
        # names of functions are operators to latex2mathml, with blanks around them
        ("<mo>([A-Za-z][A-Za-z0-9]+)</mo>", r"<mi>\1</mi>"),
        ("<mo>H</mo>", '<mi mathvariant="normal">H</mi>'),
        ("<mo>(/|&#x0002F;)</mo>", '<mo lspace="0" rspace="0">/</mo>'),
    )
]
_ATTRIBUTES = {
    "math": {"display"},
    "mi": {"mathvariant"},
    "mo": {"stretchy", "fence", "form", "lspace", "rspace"},
    "mspace": {"width"},
    "mtd": {"style"},
}


@lru_cache(maxsize=500)
def mathml(expr: sympy.Expr, display: bool = False) -> str:
    """Write a formula as MathML for a page: shown by every current browser without network or script.

    Parameters
    ----------
    expr
        Any expression.
    display
        On a line of its own rather than within text.

    Returns
    -------
    str
        One ``math`` element; everything but elements and harmless attributes of MathML has been sieved out.
    """
    from latex2mathml.converter import convert  # 0.06 s, and needed for pages only

    markup = convert(latex(expr), display="block" if display else "inline")
    for pattern, instead in _MENDED:
        markup = pattern.sub(instead, markup)
    clean = nh3.clean(
        markup, tags=_TAGS, attributes=_ATTRIBUTES, filter_style_properties={"text-align"}, url_schemes=set()
    )
    return clean.replace("&nbsp;", "\u00a0")  # an entity of HTML that XML does not know
