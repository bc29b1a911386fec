"""Random tests of random laws, fitted with the right law and with wrong ones: part of reports/verdicts.md.

Everything is seeded: a kind, a first seed and a number of tests give the same rows. Run in parts:
``python -m benchmarks.campaign --kind missing --tests 100 --seed 1``; ``--write`` renews the section.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("RSGEN_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import rsgen
from rsgen.common.output import write_atomic
from rsgen.common.tolerances import interval_sigmas
from rsgen.data.surface.response_surface import ResponseSurface
from rsgen.identification.results import Estimate

REPORT = Path(__file__).parent.parent / "reports" / "verdicts.md"
HEADING = "## Random tests"
TESTS, SEED = 120, 1
FAR, WIDE = 4.0, float(interval_sigmas())
"""Standard errors beyond which an identified value is wrong, and to both ends of a 95 % interval."""
SLOW = 30
"""Times the median that no identification may take."""

Values = dict[str, float]


@dataclass(frozen=True)
class Truth:
    """A law, the mass [kg], and the amplitude X [m] that a linear oscillator has at the largest force."""

    law: str
    values: Values
    mass: float
    size: float

    @property
    def speed(self) -> float:
        """X omega [m/s] at the resonance without nonlinear terms."""
        return self.size * float(np.sqrt(self.values["k"] / self.mass))


LINEAR = "k*x + c*v"
LAWS: dict[str, tuple[str, Callable[[float, float, float], Values]]] = {
    "hardening": ("k3*x**3", lambda k, X, V: {"k3": 0.4 * k / X**2}),
    "softening": ("k3*x**3", lambda k, X, V: {"k3": -0.15 * k / X**2}),
    "quintic": ("k3*x**3 + k5*x**5", lambda k, X, V: {"k3": 0.2 * k / X**2, "k5": 0.2 * k / X**4}),
    "friction": ("Ff*sign(v)", lambda k, X, V: {"Ff": 0.01 * k * X}),
    "drag": ("k3*x**3 + c2*v*abs(v)", lambda k, X, V: {"k3": 0.3 * k / X**2, "c2": 0.02 * k * X / V**2}),
    "gap": (
        "Piecewise((kg*(x-b), x>b), (kg*(x+b), x<-b), (0, True))",
        lambda k, X, V: {"kg": 0.6 * k, "b": 0.4 * X},
    ),
    "one-sided": ("kb*Max(x, 0)", lambda k, X, V: {"kb": 0.2 * k}),
    "slider": ("masing(Min(kt*x, Fs))", lambda k, X, V: {"kt": 0.2 * k, "Fs": 0.05 * k * X}),
}
"""What is added to a linear oscillator of stiffness k that reaches X [m] and V [m/s]."""

TERMS: dict[str, Callable[[float, float, float], float]] = {
    "x**5": lambda k, X, V: k / X**4,
    "v*abs(v)": lambda k, X, V: 0.2 * k * X / V**2,
    "sign(v)": lambda k, X, V: 0.1 * k * X,
    "v**3": lambda k, X, V: 0.2 * k * X / V**3,
}
"""Terms that a fitted law lacks or has too many, with what its coefficient is a hundredth or more of."""


@dataclass(frozen=True)
class Drawn:
    """A test that was drawn: what is true, what is tried, and what is fitted to it."""

    truth: Truth
    test: rsgen.SimulatedTest
    harmonics: bool  # whether mean and higher harmonics were recorded
    fitted: str
    mass: float | None = None  # that is given

    @property
    def recorded(self) -> str:
        """What of the response was recorded, in a word."""
        return "harmonics" if self.harmonics else "fundamentals"

    def surface(self) -> ResponseSurface:
        """As it would be measured."""
        truth = self.truth
        surface = rsgen.simulate(rsgen.Oscillator(truth.mass, truth.law, truth.values), self.test)
        if self.harmonics:
            return surface
        harmonics = np.full(surface.harmonics.shape, np.nan, dtype=complex)
        harmonics[:, 1] = surface.harmonics[:, 1]
        return replace(surface, harmonics=harmonics, peak=np.full(surface.peak.shape, np.nan))


def draw(seed: int, laws: Sequence[str] = tuple(LAWS)) -> Drawn:
    """Draw a law, a test of it, and fit the right law."""
    random = np.random.default_rng(seed)
    added, of_size = LAWS[laws[random.integers(len(laws))]]
    mass, natural, zeta = random.uniform(0.5, 3), random.uniform(5, 30), random.uniform(0.004, 0.03)
    k, size = mass * (2 * np.pi * natural) ** 2, 10 ** random.uniform(-4, -2)
    linear = {"k": k, "c": 2 * zeta * np.sqrt(k * mass)}
    law = f"{LINEAR} + {added}"
    truth = Truth(law, linear | of_size(k, size, size * 2 * np.pi * natural), mass, size)
    levels = 2 * zeta * k * size * random.uniform(0.8, 1.5) * np.linspace(0.2, 1, random.integers(3, 7))
    band = random.uniform(0.1, 0.3)
    test = rsgen.SimulatedTest(
        level=levels.round(6),
        frequency=natural * np.linspace(1 - band, 1 + band, random.integers(15, 50)),
        noise_relative=float(random.choice([0, 0.001, 0.003, 0.01, 0.03])),
        seed=seed,
    )
    return Drawn(truth, test, bool(random.integers(2)), law)


def _term(drawn: Drawn, random: np.random.Generator) -> tuple[str, float]:
    """Draw a term that the law does not have, and a coefficient."""
    truth = drawn.truth
    terms = [term for term in TERMS if term not in truth.law]
    term = terms[random.integers(len(terms))]
    return term, random.uniform(0.01, 0.05) * TERMS[term](truth.values["k"], truth.size, truth.speed)


def _add(drawn: Drawn, term: str, value: float) -> Drawn:
    """Add a term to the truth that the fitted law lacks."""
    truth = drawn.truth
    law = f"{truth.law} + more*{term}"
    return replace(drawn, truth=replace(truth, law=law, values={**truth.values, "more": value}))


def _missing(drawn: Drawn, random: np.random.Generator) -> Drawn:
    return _add(drawn, *_term(drawn, random))


def _too_many(drawn: Drawn, random: np.random.Generator) -> Drawn:
    term, _ = _term(drawn, random)
    return replace(drawn, fitted=f"{drawn.fitted} + more*{term}")


def _asymmetric(drawn: Drawn, random: np.random.Generator) -> Drawn:
    k = drawn.truth.values["k"]
    return _add(drawn, "x**2", random.uniform(0.02, 0.2) * k / drawn.truth.size)


def _wrong_mass(drawn: Drawn, random: np.random.Generator) -> Drawn:
    return replace(drawn, mass=drawn.truth.mass * float(random.choice([0.9, 0.95, 1.05, 1.1])))


def _few_points(drawn: Drawn, random: np.random.Generator) -> Drawn:
    frequency = drawn.test.frequency
    count = int(random.integers(6, 11))
    places = np.linspace(0, len(frequency) - 1, count).round().astype(int)
    return replace(drawn, test=replace(drawn.test, frequency=frequency[places]))


def _two_levels(drawn: Drawn, random: np.random.Generator) -> Drawn:
    return replace(drawn, test=replace(drawn.test, level=drawn.test.level[[0, -1]]))


def _one_side(drawn: Drawn, random: np.random.Generator) -> Drawn:
    frequency = drawn.test.frequency
    middle = frequency.mean()
    kept = frequency < middle if random.integers(2) else frequency > middle
    return replace(drawn, test=replace(drawn.test, frequency=frequency[kept]))


def _barely_passed(drawn: Drawn, random: np.random.Generator) -> Drawn:
    """A gap that the largest of 40 points passes by 4 %; only the seed of the noise is drawn."""
    values = {"k": 6000.0, "c": 4.0, "kg": 6000.0, "b": 3e-3}
    law = f"{LINEAR} + kg*(Max(x - b, 0) + Min(x + b, 0))"
    force = 1.06 * values["b"] * values["c"] * 2 * np.pi * 10.07
    test = rsgen.SimulatedTest(
        level=force * np.array([0.25, 0.5, 0.75, 1.0]),
        frequency=np.linspace(9.85, 10.35, 10),
        noise_relative=0.01,
        seed=drawn.test.seed,
    )
    return Drawn(Truth(law, values, 1.5, values["b"]), test, True, law)


KINDS: dict[str, Callable[[Drawn, np.random.Generator], Drawn]] = {
    "right": lambda drawn, random: drawn,
    "few points": _few_points,
    "two levels": _two_levels,
    "one side": _one_side,
    "too many": _too_many,
    "missing": _missing,
    "asymmetric": _asymmetric,
    "wrong mass": _wrong_mass,
    "barely passed": _barely_passed,
}
RIGHT = ("right", "few points", "two levels", "one side")
_compiled: set[str] = set()
"""Laws that were fitted: the first fit of each compiles it, and is not timed."""


@dataclass(frozen=True)
class Row:
    """One random test and what became of it."""

    kind: str
    seed: int
    drawn: Drawn
    state: str
    deciding: tuple[str, ...]
    codes: frozenset[str]
    deviation: Values  # from the truth, in standard errors of the interval that is stated
    share: Values  # the same relative to the true value
    covered: dict[str, bool]  # whether the 95 % interval of a value has the true one
    seconds: float

    @property
    def identified(self) -> bool:
        """Whether a reader would take the numbers for good."""
        return self.state == "identified"

    @property
    def doubted(self) -> bool:
        """Whether there are numbers that a reader is told to doubt; a refusal has none."""
        return self.state in {"doubtful", "rejected"}

    @property
    def worst(self) -> float:
        """Largest deviation of an identified value in standard errors."""
        return max(map(abs, self.deviation.values()), default=0.0)

    @property
    def wrong(self) -> bool:
        """Whether the result reads well and a value is far off."""
        return self.identified and self.worst > FAR

    @property
    def stated(self) -> bool:
        """Whether the result says what the test cannot see: a mirror image, or the even term that lacks."""
        even = self.kind == "asymmetric" and "even-terms-not-seen" in self.codes
        return even or "mirror-image-fits" in self.codes

    def __str__(self) -> str:
        values = {name: f"{z:.1f} ({100 * self.share[name]:.2g} %)" for name, z in self.deviation.items()}
        drawn = self.drawn
        return (
            f"{self.kind} {self.seed}: {drawn.truth.law} as {drawn.fitted}, "
            f"noise {drawn.test.noise_relative:g}, {drawn.recorded}, {len(drawn.test.level)} by "
            f"{len(drawn.test.frequency)}: {self.state} {', '.join(self.deciding)} {values} "
            f"{self.seconds:.2f} s"
        )


def run(kind: str, seed: int, laws: Sequence[str] = tuple(LAWS)) -> Row:
    """Draw a test, identify it and compare with the truth."""
    drawn = KINDS[kind](draw(seed, laws), np.random.default_rng([seed, 1]))
    truth = {"more": 0.0, **drawn.truth.values, "m": drawn.truth.mass}
    surface = drawn.surface()
    begin = time.process_time()
    try:
        found = rsgen.identify(surface, drawn.fitted, mass=drawn.mass)
        if drawn.fitted not in _compiled:
            _compiled.add(drawn.fitted)
            begin = time.process_time()
            found = rsgen.identify(surface, drawn.fitted, mass=drawn.mass)
    except rsgen.RsgenError as fault:
        return Row(
            kind,
            seed,
            drawn,
            "refused",
            (str(fault)[:60],),
            frozenset(),
            {},
            {},
            {},
            time.process_time() - begin,
        )
    seconds = time.process_time() - begin
    judged = [e for e in found if e.identifiable and e.name in truth]
    verdict = found.verdict
    return Row(
        kind,
        seed,
        drawn,
        verdict.state,
        tuple(finding.code for finding in verdict.decided_by),
        frozenset(finding.code for finding in found.findings),
        {e.name: _deviation(e, truth[e.name]) for e in judged},
        {e.name: e.value / truth[e.name] - 1 if truth[e.name] else np.nan for e in judged},
        {
            e.name: e.interval[0] <= truth[e.name] <= e.interval[1]
            for e in found
            if e.name in truth and (e.identifiable or e.by_profile)
        },
        seconds,
    )


def _deviation(estimate: Estimate, true: float) -> float:
    """Deviation from the truth; by a profile the distance to the end of its interval has ``WIDE`` units."""
    far, error = estimate.value - true, estimate.standard_error
    if estimate.by_profile:
        error = abs(estimate.interval[int(far < 0)] - estimate.value) / WIDE
    return far / error


def section(rows: Sequence[Row]) -> list[str]:
    """Make the section of the report."""
    seeds = sorted({row.seed for row in rows})
    named = f"Seed {seeds[0]}" if len(seeds) == 1 else f"Seeds {seeds[0]} to {seeds[-1]}"
    lines = [
        HEADING,
        "",
        f"{named} of each kind (`python -m benchmarks.campaign`).",
        "Random laws, levels, frequencies and noise (0 to 3 %), with all harmonics or fundamentals only. The",
        "law that is fitted is right, lacks a term or has one too many. *Wrong*: identified, and a value is",
        f"more than {FAR:g} standard errors off (asked: none). *Stated*: wrong, but the result says what",
        "fundamentals do not show, an even term or the mirror image. *Misses*: values of identified tests",
        "with noise whose 95 % interval has not the true one (asked of right laws: 4 to 6 %). Tests that are",
        "neither identified nor doubtful or rejected are refused. Times are without compilation of the law.",
        "",
        "| kind | recorded | tests | identified | doubtful or rejected | stated | wrong | misses |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        for harmonics in (True, False):
            part = [row for row in rows if row.kind == kind and row.drawn.harmonics == harmonics]
            if part:
                lines.append(f"| {kind} | {part[0].drawn.recorded} {_counts(part)}")
    right = [row for row in rows if row.kind in RIGHT]
    if right:
        doubted = [row for row in right if row.doubted]
        lines += [
            "",
            f"Right law, all tests: misses {_misses(right)}; doubtful or rejected "
            f"{_share(len(doubted), len(right))} (asked at most 3 %).",
        ]
    seconds = np.array([row.seconds for row in rows])
    slow = int(np.count_nonzero(seconds > SLOW * np.median(seconds)))
    lines += [
        "",
        f"Longest identification {seconds.max() / np.median(seconds):.0f} times the median; "
        f"{slow} of {len(rows)} beyond {SLOW}.",
    ]
    return lines


def _counts(rows: Sequence[Row]) -> str:
    identified = [row for row in rows if row.identified]
    wrong, doubted = [row for row in rows if row.wrong], sum(row.doubted for row in rows)
    unstated = sum(not row.stated for row in wrong)
    return (
        f"| {len(rows)} | {len(identified)} | {doubted} | {len(wrong) - unstated} | {unstated} "
        f"| {_misses(rows)} |"
    )


def _misses(rows: Sequence[Row]) -> str:
    covered = [
        inside
        for row in rows
        if row.identified and row.drawn.test.noise_relative > 0
        for inside in row.covered.values()
    ]
    return _share(len(covered) - sum(covered), len(covered))


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / max(whole, 1):.1f} %)"


def renewed(report: str, lines: Sequence[str]) -> str:
    """Put the section into a report in place of the one that it has."""
    before, _, after = report.partition(HEADING)
    _, heading, rest = after.partition("\n## ")
    return "\n".join([before.rstrip("\n"), "", *lines, ""]) + (heading + rest).replace("\n", "\n", 1)


def main() -> None:
    """Run the kinds asked for."""
    warnings.simplefilter("ignore")
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--kind", action="append", choices=tuple(KINDS))
    reader.add_argument("--law", action="append", choices=tuple(LAWS))
    reader.add_argument("--tests", type=int, default=TESTS)
    reader.add_argument("--seed", type=int, default=SEED)
    reader.add_argument("--write", action="store_true")
    reader.add_argument("--all", action="store_true", help="print each test, not only those that fail")
    asked = reader.parse_args()
    rows = []
    for kind in asked.kind or KINDS:
        for seed in range(asked.seed, asked.seed + asked.tests):
            row = run(kind, seed, asked.law or tuple(LAWS))
            rows.append(row)
            fails = row.wrong or (kind in RIGHT and not row.identified)
            if fails or asked.all:
                print(row, flush=True)
    lines = section(rows)
    print("\n".join(lines))
    if asked.write:
        write_atomic(REPORT, renewed(REPORT.read_text(encoding="utf-8"), lines))


if __name__ == "__main__":
    main()
