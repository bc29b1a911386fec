"""The list of findings: sentence, threshold, place and next step of each, from the source and its texts."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from rsgen.common.finding import Finding
from rsgen.report.sentences import CODES, NEXT_STEPS

from .made_findings import SEVERITIES, Threshold, places_of_findings, places_that_keep, texts_of

_SIGN = re.compile(r"`[^`]*`|[<*$\[]")
_FIELD = re.compile(r"\{(\w+)(?::[^}]*)?\}")
_BEGIN = re.compile(r"\[\[(?:[^|{}\]]*\|)?")
_BETWEEN = re.compile(rf"\]\]{_BEGIN.pattern}")


@dataclass(frozen=True)
class Entry:
    """What the page says of a finding; numbers of a result stand in angle brackets."""

    code: str
    severities: tuple[str, ...]
    sentences: tuple[str, ...]
    thresholds: tuple[str, ...]
    places: tuple[str, ...]
    kept_by: tuple[str, ...]
    step: str


def entries() -> Iterator[Entry]:
    """Return an entry a finding, by code."""
    places = places_of_findings()
    for code in sorted(set(CODES) - {"note"}):
        made = places[code]
        found = {severity for place in made for severity in place.severities}
        wheres = tuple(dict.fromkeys(place.where for place in made))
        keeping = dict.fromkeys(one for where in wheres for one in places_that_keep().get(where, ()))
        yield Entry(
            code,
            tuple(severity for severity in SEVERITIES if severity in found),
            tuple(_said(CODES[code])),
            tuple(_thresholds(one for place in made for one in place.thresholds)),
            wheres,
            tuple(one for one in keeping if one not in wheres and ".app." not in one),
            " / ".join(filter(None, _said(NEXT_STEPS[code], words=False))) if code in NEXT_STEPS else "",
        )


def _thresholds(given: Iterable[Threshold]) -> Iterator[str]:
    """Thresholds of all places, each once; those of the severity first, and marked."""
    made = list(given)
    grading = {one.name for one in made if one.grades}
    named = {one.name: one for one in made}
    for one in sorted(named.values(), key=lambda one: one.name not in grading):
        reason = f": {_escape(one.reason.rstrip('.'))}" if one.reason else ""
        yield f"`{one.name}` = {one.value:g}{', of the severity' * (one.name in grading)}{reason}."


def _said(say: Callable[[Finding], str], words: bool = True) -> Iterable[str]:
    """The sentence that a function says, and words of its names; of one with logic each that it returns."""
    if isinstance(say, partial):
        texts = [say.args[0]] if isinstance(say.args[0], str) else say.args[0].values()
        # what is said under conditions only stands in brackets, alternatives with a stroke between
        parts = (_BEGIN.sub("(", _BETWEEN.sub(" / ", text)).replace("]]", ")") for text in texts)
        called = (f"<{name}>: {'; '.join(them.values())}" for name, them in say.args[1].items())
        return [*(_FIELD.sub(r"<\1>", text) for text in parts), *(called if words else ())]
    tree = ast.parse(textwrap.dedent(inspect.getsource(say)))
    returned = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return) and node.value]
    return dict.fromkeys(map(_text, returned))


def _text(node: ast.expr) -> str:
    """A text of the source, with names in angle brackets for what a result puts in."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(map(_text, parts))
        case ast.IfExp(body=one, orelse=other):
            return f"{_text(one)} / {_text(other)}"
        case ast.FormattedValue(value=value):
            return f"<{(texts_of(value) or [ast.unparse(value)])[0]}>"
    return f"<{(texts_of(node) or [ast.unparse(node)])[0]}>"


def findings_list() -> str:
    """Write the findings in Markdown, a section each."""
    return "\n\n".join(map(_section, entries()))


def _section(one: Entry) -> str:
    parts = [f"## `{one.code}`", f"Severity: {', '.join(one.severities)}."]
    parts.append("\n".join(f"* {_escape(sentence)}" for sentence in one.sentences))
    parts += [f"Next step: {_escape(one.step)}"] if one.step else []
    parts += (
        ["\n".join(["Thresholds:", "", *(f"* {text}" for text in one.thresholds)])] if one.thresholds else []
    )
    parts.append(f"Made by {', '.join(f'`{place}`' for place in one.places)}.")
    parts += (
        [f"Kept, or acted on, by {', '.join(f'`{place}`' for place in one.kept_by)}."] if one.kept_by else []
    )
    return "\n\n".join(parts)


def _escape(text: str) -> str:
    """Escape what would be markup; literals stay, with one mark on either side."""
    return _SIGN.sub(lambda sign: sign[0] if len(sign[0]) > 1 else "\\" + sign[0], text.replace("``", "`"))
