"""Subject and provenance of a report: case, law and truth; versions, machine and hashes; and escaping.

Nothing from a file is markup. ``page_environment`` is the template environment of all pages: it escapes every
value, and a missing one is an error. ``_finalize`` makes invisible characters visible (``plain_text``),
``verbatim`` does so for a text with its lines, such as a case file, and ``coded`` shows as code what stands
between backticks. Other ``Markup`` is made in ``report/page`` alone, of formulas and figures of rsgen.
"""

from __future__ import annotations

import datetime
import platform
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jinja2
import sympy
from markupsafe import Markup, escape

import rsgen
from rsgen.cases.case import Case
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.files.plan import MeasuredTest
from rsgen.formula.bounds import MAX_CHARACTERS
from rsgen.identification.results import Identification
from rsgen.law.element import Element
from rsgen.law.memory import with_equations

# ----------------------------------------------------------------------------
# The template environment: everything from a file is text, and a missing value is an error.

_CATEGORIES = {"Cc", "Cf", "Cs", "Co", "Zl", "Zp"}


TEMPLATES = Path(__file__).resolve().parents[1] / "templates"
"""Package data; the folder `templates` of the checkout is a link to it."""


def plain_text(text: str, most: int = MAX_CHARACTERS, keep: str = "") -> str:
    r"""Make invisible characters visible: controls, direction marks, lone surrogates become escapes.

    Parameters
    ----------
    most
        Longer texts are cut, and say so.
    keep
        Characters to leave as they are, such as line ends.

    Examples
    --------
    >>> plain_text("a\x1b[2Jb"), plain_text("\u202egpj.exe")
    ('a\\x1b[2Jb', '\\u202egpj.exe')
    """
    if len(text) > most:
        text = f"{text[:most]}… ({len(text)} characters)"
    return "".join(
        character
        if character in keep or unicodedata.category(character) not in _CATEGORIES
        else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def verbatim(text: str) -> Markup:
    """Return a text of several lines for a ``<pre>`` block: escaped, line ends and tabs kept."""
    return Markup(escape(plain_text(text.replace("\r\n", "\n"), most=200_000, keep="\n\t")))  # noqa: S704 - escaped


def coded(text: str) -> Markup:
    """Show what stands between backticks in a sentence of ours as code; all of it is escaped.

    Examples
    --------
    >>> print(coded("try `rsgen rank <file>` & look"))
    try <code>rsgen rank &lt;file&gt;</code> &amp; look
    """
    shown = str(escape(plain_text(text)))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", shown))  # noqa: S704 - escaped


def unbroken(text: str) -> str:
    """Keep a number, its power of ten and its unit on one line.

    Examples
    --------
    >>> unbroken("4.1 × 10⁻⁶ %")
    '4.1\xa0×\xa010⁻⁶\xa0%'
    """
    return str(text).replace(" × ", "\u00a0×\u00a0").replace(" %", "\u00a0%")


def _finalize(value: object) -> object:
    return plain_text(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def template_environment(
    autoescape: bool, finalize: Callable[[Any], object] | None = None
) -> jinja2.Environment:
    """Return an environment of templates; undefined names are errors, and ``finalize`` sees every value."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=autoescape,  # noqa: S701 - off where no HTML is written
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        finalize=finalize,
    )


@cache
def page_environment() -> jinja2.Environment:
    """Return the environment of the HTML pages: autoescape on."""
    environment = template_environment(True, _finalize)
    environment.filters.update(verbatim=verbatim, unbroken=unbroken, coded=coded)
    return environment


_PACKAGES = ("numpy", "scipy", "sympy", "numba", "matplotlib", "h5py", "pydantic", "pint")


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of rsgen, Python and the packages that results depend on."""
    found = {"rsgen": rsgen.__version__, "python": platform.python_version()}
    for package in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def _origin(case: Case | None) -> dict[str, str]:
    """Name the case file and its test; empty without a case file."""
    if case is None:
        return {}
    return {"Case file": case.path.name, "SHA-256 of the case": case.sha256, **case.test.origin()}


def collect_provenance(
    case: Case | None,
    surface: ResponseSurface | MultisineSpectra,
    durations: Mapping[str, float],
    command: Sequence[str],
) -> dict[str, str]:
    """Return name and value pairs for the last section of the page.

    Parameters
    ----------
    durations
        Seconds by stage.
    command
        What was called; empty where rsgen was used from Python.
    """
    entries = {
        **_origin(case),
        **surface.provenance,
        "Versions": ", ".join(f"{name} {number}" for name, number in package_versions().items()),
        "Machine": f"{platform.system()} {platform.machine()}, {platform.python_implementation()}",
        "Command": " ".join(command) or "called from Python",
        "Written": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    if durations:
        entries["Durations"] = ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in durations.items())
    return entries


# ----------------------------------------------------------------------------
# The subject of a report: the heading, the law, the truth; from a case file, or from the result alone.


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The heading of a report and what is known about the structure.

    Parameters
    ----------
    name, title, source
        As in ``Case``; printable text, never markup.
    elements
        The springs and dampers that were identified.
    truth, printed
        As in ``Case``, as far as they concern these elements.
    case
        Where all this comes from; None where a report is made without a case file.
    """

    name: str
    title: str
    source: str
    elements: tuple[Element, ...]
    truth: Mapping[str, float] | None = None
    printed: Mapping[str, sympy.Expr] = field(default_factory=dict)
    case: Case | None = None

    @property
    def scale_is_sure(self) -> bool:
        """True where a case says that amplitudes are root mean squares, or reads samples, which are none."""
        test = None if self.case is None else self.case.test
        return isinstance(test, MeasuredTest) and (
            test.history is not None or any(channel.scale == "rms" for channel in test.sources)
        )

    @classmethod
    def of_case(cls, case: Case, identification: Identification) -> Subject:
        """Take over a case; what concerns another law than the identified one is left out."""
        case = case.with_model(identification.model_given)
        heading = (case.name, case.title or case.name, case.source, case.model.elements)
        return cls(*heading, case.truth, case.printed, case)

    @classmethod
    def of_result(cls, identification: Identification, name: str, title: str, source: str) -> Subject:
        """Take the heading as it is given; without a title the law is the title."""
        model = identification.model
        title = title or f"n(x, v) = {with_equations(model.force)}"
        return cls(name, title, source, model.elements)
