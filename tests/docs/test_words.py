"""The words of README.md, docs/ and rsgen/: those of the field, one for one thing, spelled one way."""

import ast
import re
from pathlib import Path

from docs._extension.snippets import ROOT

PAGES = [
    ROOT / "README.md",
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts),
]

SOURCES = [
    path
    for path in sorted((ROOT / "rsgen").rglob("*"))
    if path.suffix in {".py", ".html", ".css", ".txt", ".j2", ".toml"}
]

# words that stand for a relation or a person without naming it
VAGUE = {
    r"besides?": "near, next to, with, in addition to", r"apart": "separately, independent",
    r"aside": "excluded", r"(?:no|some|every)body": "the thing or the person that is meant",
}  # fmt: skip
# patterns of whole words that are not the field's, or not the project's spelling: what to write
NOT_OURS = {
    r"untold|un-?told": "not identifiable",
    r"tells? (?:apart|of) (?:the )?parameters?": "determines",
    r"besides? the mode": "background",
    r"leaves? the middle|uneven": "asymmetric, offset from zero mean",
    r"unbent|unbend\w*": "curvature bias removed",
    r"quieten\w*": "denoise",
    r"polish\w*": "refit with the simulator",
    r"enrich\w*": "add harmonics",
    r"lanes?|march(?:es|ed|ing)?": "points, integrate",
    r"house|rooms?|floors?": "package, module, layer",
    r"keeps? (?:its|their) word": "coverage",
    r"so (?:many|few) as": "at least n, at most n",
    r"force without a law": "nonparametric restoring force",
    r"non-linear\w*": "nonlinear",
    r"damping (?:factor|coefficient ratio)": "damping ratio",
    r"eigen ?frequenc\w+|natural pulsation": "natural frequency, resonance",
    r"stiffnesses": "stiffness",
    r"frequency response curves?": "resonance curve, frequency response function",
    r"back-bone|back bone": "backbone",
    r"ring down": "free decay",
    r"steady-states?": "steady state",
    r"time-?series": "time history",
    r"data-?set": "data set",
    r"colors?|gray|behavior\w*": "colour, grey, behaviour",
    r"modell?ing error": "misfit of the law",
    r"simply|just|obviously|of course|very|utilize\w*|leverage\w*|in order to": "nothing, or: use, to",
    r"e\.g\.|i\.e\.|etc\.": "for example, that is",
}

# programs, formulas and addresses
CODE = re.compile(r"^```.*?^```|`[^`]*`|\$[^$]*\$|\]\([^)]*\)|\\<[^>]*>", re.MULTILINE | re.DOTALL)
LONGEST = 40  # words of a sentence, at most: readers have other mother tongues


def prose(path: Path) -> str:
    return CODE.sub(" ", path.read_text(encoding="utf-8"))


def wrong_words(text: str, banned: dict[str, str] = NOT_OURS) -> list[str]:
    return [
        f"{found[0]!r}: write {instead}"
        for pattern, instead in banned.items()
        for found in re.finditer(rf"\b(?:{pattern})(?!\w)", text, re.IGNORECASE)
    ]


def test_relations_and_persons_are_named():
    # codes of findings ("points-set-aside") and their numbers keep their names
    named = r"\b\w+(?:-\w+)+\b|\[[\"']aside[\"']\]|[{\"]aside[:\"]"
    for path in (*PAGES, *SOURCES):
        assert wrong_words(re.sub(named, " ", path.read_text(encoding="utf-8")), VAGUE) == [], path


def test_docstrings_begin_with_a_verb_or_a_noun():
    kinds = ast.Module | ast.ClassDef | ast.FunctionDef
    for path in (path for path in SOURCES if path.suffix == ".py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        texts = (ast.get_docstring(node) for node in ast.walk(tree) if isinstance(node, kinds))
        first = {text.split()[0] for text in texts if text}
        assert first & {"Give", "Gives", "What", "Whether"} == set(), path


def test_words_are_those_of_the_field():
    assert {path: wrong for path in PAGES if (wrong := wrong_words(prose(path)))} == {}


def test_sentences_are_short():
    for path in PAGES:
        text = re.sub(r"^(?:#.*|\|.*|:::.*)$", ".", prose(path), flags=re.MULTILINE)
        text = re.sub(r"^\s*(?:[*-]|\d+\.|:)\s", ". ", text, flags=re.MULTILINE)
        sentences = re.split(r"(?<=[.:;?!])\s", " ".join(text.split()))
        assert [sentence for sentence in sentences if len(sentence.split()) > LONGEST] == [], path
