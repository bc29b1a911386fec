"""Identification of a law from a periodic multisine: the balance of every line, weighted by its noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsgen.arrays import Array, ComplexArray
from rsgen.errors import RsgenError
from rsgen.finding import Finding, Quantity, quantities
from rsgen.identification.findings import make_estimates, names_of, units_of
from rsgen.identification.fit import Solution
from rsgen.identification.least_squares import solve_scaled
from rsgen.identification.line_balance import Balance, Lines, NoiseOfBalance, lines_of
from rsgen.identification.line_start import start_values
from rsgen.identification.misfit import severity_of
from rsgen.identification.result import EquivalentCurve, Identification, Resonance, frozen_array
from rsgen.identification.tolerances import CHANCE, EXCESS, NULL_PART
from rsgen.law.numeric import ForceLaw, compile_law
from rsgen.multisine import BestLinear, MultisineSpectra, best_linear
from rsgen.multisine.spectra import smooth
from rsgen.oscillator import Model

__all__ = ["MultisineIdentification", "identify_multisine"]

_ROUNDS = 4
"""Fits, each with the weights of the one before: two settle them, the others see to it."""
_STEPS = 40
"""Gauss-Newton steps of a fit."""
_HALVINGS = 8
"""Halvings of a step that does not lower the misfit."""
_SMALL = 1e-11
"""Relative step of every parameter at which the fit has converged."""
_BESIDE = 20
"""Lines to each side over which the power of the misfit is averaged: forty-one make it known to a quarter."""
_BLOCKS = 8
"""Parts of the band that the jackknife leaves out in turn, of each record."""
_POOR, _MEANINGLESS = 0.05, 0.2
"""Systematic misfits, relative to the force, that cast doubt on a law, and refute it: as for surfaces."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MultisineIdentification(Identification):
    """What a multisine test determines of a model: an ``Identification``, and the spectra behind it.

    ``paper`` and ``first_order`` hold no estimates: both read one harmonic. ``resonances`` are those of the
    best linear approximation of each level; their amplitude is sqrt(2) times the rms displacement.

    Parameters
    ----------
    spectra
        All records, those held out too.
    approximations
        Best linear approximation of every level that took part.
    used
        (r, H+1) lines of each record that took part.
    misfit
        (r, H+1) balance of each record that took part, F - m x'' - n, at each line [N].
    deviation
        (r, H+1) standard deviation of that balance, from the scatter of the periods [N]; NaN of one period.
    """

    spectra: MultisineSpectra | None = None
    approximations: tuple[BestLinear, ...] = ()
    used: NDArray[np.bool_] | None = None
    misfit: ComplexArray | None = None
    deviation: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Values, mass, the balance there, and the variance (r, H+1) that weighs it."""

    values: Array
    mass: float
    balance: Balance
    noise: NoiseOfBalance
    variance: Array
    converged: bool


def identify_multisine(spectra: MultisineSpectra, model: Model) -> MultisineIdentification:
    """Identify every parameter of a law, and the mass where it is not given, from periodic records.

    Parameters
    ----------
    spectra
        Force and displacement by record, period and line.
    model
        Laws without values; its observation holds levels out and limits the band.

    Raises
    ------
    RsgenError
        A held-out level is not in the records, nothing is left, or the observation asks for a background.
    """
    observation = model.observation
    if observation.background != "none":
        raise RsgenError(
            f"identify.background: {observation.background!r}; a multisine test is identified without a "
            "background: leave it out, and take a band around the mode"
        )
    held = held_out_records(spectra, observation.hold_out)
    if held.all():
        raise RsgenError("identify.hold_out: holds every level back; at least one must remain")
    part = spectra.select(np.flatnonzero(~held))
    lines = lines_of(part, observation.band)
    law = compile_law(model.force)
    count = int(lines.used.sum())
    if 2 * count <= len(law.parameters) + 1:
        raise RsgenError(f"identify.band: {count} lines in it; more lines than parameters are needed")
    with np.errstate(all="ignore"):
        values, mass = start_values(lines, law, model.mass)
        fit = _fit(lines, law, model.mass, values, mass)
        return _judge(spectra, lines, law, model, fit)


def held_out_records(spectra: MultisineSpectra, levels: tuple[float, ...]) -> NDArray[np.bool_]:
    """(r,) records of the held-out levels [N].

    Raises
    ------
    RsgenError
        A level was not tested.
    """
    held = np.zeros(len(spectra), dtype=bool)
    for level in levels:
        rows = spectra.at_level(level)
        if not len(rows):
            known = ", ".join(f"{one:.4g}" for one in spectra.levels)
            raise RsgenError(f"identify.hold_out: {level:g} N is not tested; tested are {known} N")
        held[rows] = True
    return held


def _weights(lines: Lines, balance: Balance, noise: NoiseOfBalance, mass: float) -> Array:
    """(r, H+1) variance of each line: its noise, or the misfit around it where that is clearly more."""
    left = np.stack(
        [_beside(np.abs(one) ** 2, used) for one, used in zip(balance.residual, lines.used, strict=True)]
    )
    known = np.isfinite(noise.variance)
    # the smoothed power of pure noise exceeds this once in thousands
    chance = 1 + CHANCE / np.sqrt(2 * _BESIDE + 1)
    clear = ~known | (left > chance * noise.variance)
    variance = np.where(clear, left, noise.variance)
    return np.maximum(variance, 1e-26 * lines.scale(mass))


def _beside(power: Array, used: NDArray[np.bool_]) -> Array:
    """(H+1,) average of a power over the neighbouring used lines."""
    chosen = np.flatnonzero(used)
    result = np.zeros(len(power))
    result[chosen] = smooth(np.concatenate([[0.0], power[chosen]]), _BESIDE)[1:]
    return result


def _fit(lines: Lines, law: ForceLaw, given: float | None, values: Array, mass: float) -> _Fit:
    """Gauss-Newton with fixed weights, then weights of its result, some times over."""
    noise = NoiseOfBalance.unknown(lines, len(values))
    variance = lines.scale(mass)
    balance = Balance.of(lines, law, values, mass, noise)
    converged = False
    for turn in range(_ROUNDS):
        values, mass, balance, converged = _descend(lines, law, given, values, mass, noise, variance)
        if noise.together.any():
            values, mass = _without_bias(lines, balance, noise, variance, given, values, mass)
            balance = Balance.of(lines, law, values, mass, noise)
        if turn < _ROUNDS - 1:
            noise = balance.noise(lines, law, values, mass)
            variance = _weights(lines, balance, noise, mass)
    return _Fit(values, mass, balance, noise, variance, converged)


def _without_bias(
    lines: Lines,
    balance: Balance,
    noise: NoiseOfBalance,
    variance: Array,
    given: float | None,
    values: Array,
    mass: float,
) -> tuple[Array, float]:
    """Take off what noise in the slopes, which goes with that of the balance, adds to the estimate."""
    matrix, right = _rows(lines, balance, variance, given)
    size = np.append(values, mass) if given is None else values
    inverse = solve_scaled(matrix, right, size)[1]
    weighted = np.moveaxis(noise.together, 1, 2)[lines.used] * (2 / variance)[lines.used][:, None]
    score = weighted.sum(axis=0)[: matrix.shape[1]]
    change = -inverse @ (inverse.T @ score)
    return values + change[: len(values)], mass + float(change[-1]) if given is None else mass


def _rows(lines: Lines, balance: Balance, variance: Array, given: float | None) -> tuple[Array, Array]:
    """Real rows (2 lines, q) and right side of unit variance; unknowns: parameters, the mass if free."""
    columns = balance.by_parameter
    if given is None:
        columns = np.concatenate([columns, balance.inertia[:, None]], axis=1)
    weight = np.sqrt(2 / variance)[lines.used]
    matrix = np.moveaxis(columns, 1, 2)[lines.used] * weight[:, None]
    right = balance.residual[lines.used] * weight
    # real and imaginary part of a line stay beside each other
    return (
        np.stack([matrix.real, matrix.imag], axis=1).reshape(-1, matrix.shape[1]),
        np.stack([right.real, right.imag], axis=1).reshape(-1),
    )


def _descend(
    lines: Lines,
    law: ForceLaw,
    given: float | None,
    values: Array,
    mass: float,
    noise: NoiseOfBalance,
    variance: Array,
) -> tuple[Array, float, Balance, bool]:
    balance = Balance.of(lines, law, values, mass, noise)
    for _ in range(_STEPS):
        matrix, right = _rows(lines, balance, variance, given)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            return values, mass, balance, False
        size = np.append(values, mass) if given is None else values
        change = solve_scaled(matrix, right, size)[0]
        before = float(right @ right)
        for part in 0.5 ** np.arange(_HALVINGS):
            moved = values + part * change[: len(values)]
            heavier = mass + part * float(change[-1]) if given is None else mass
            trial = Balance.of(lines, law, moved, heavier, noise)
            after = _rows(lines, trial, variance, given)[1]
            if float(after @ after) <= before * (1 + 1e-12):
                values, mass, balance = moved, heavier, trial
                break
        else:
            return values, mass, balance, True
        relative = np.abs(part * change) / np.maximum(np.abs(size), 1e-300)
        exact = not law.nonlinear and (lines.spectra.mean_known or law.odd)
        if exact or float(np.max(relative, initial=0.0)) < _SMALL:
            return values, mass, balance, True
    return values, mass, balance, False


def _errors(lines: Lines, fit: _Fit, given: float | None, law: ForceLaw) -> tuple[Array, Array, int, float]:
    """Covariance, null directions, degrees of freedom, and how much leaving parts out widens the errors."""
    matrix, right = _rows(lines, fit.balance, fit.variance, given)
    size = np.append(fit.values, fit.mass) if given is None else fit.values
    _, inverse, null = solve_scaled(matrix, right, size)
    covariance = inverse @ inverse.T
    freedom = max(len(right) - matrix.shape[1] + null.shape[1], 1)
    wider = 1.0
    if _systematic(lines, fit) > EXCESS:
        scores, groups = matrix * right[:, None], _groups(lines)
        count = int(groups.max()) + 1
        # leaving one part out, to first order in its share
        moved = np.stack([covariance @ scores[groups == g].sum(axis=0) for g in range(count)])
        spread = np.sqrt(np.sum((moved - moved.mean(axis=0)) ** 2, axis=0) * count / max(count - 1, 1))
        error = np.sqrt(np.diag(covariance))
        ratio = np.maximum(spread / np.where(error > 0, error, 1.0), 1.0)
        covariance = covariance * np.outer(ratio, ratio)
        wider, freedom = float(np.median(ratio)), count - 1
    lost = np.abs(null).max(axis=1, initial=0.0) > NULL_PART
    covariance[lost] = np.nan
    covariance[:, lost] = np.nan
    return covariance, null, freedom, wider


def _groups(lines: Lines) -> NDArray[np.intp]:
    """(2 lines,) parts of the band of every record, for the jackknife."""
    parts, first = [], 0
    for used in lines.used:
        count = int(used.sum())
        parts.append(np.repeat(first + np.arange(count) * _BLOCKS // max(count, 1), 2))
        first += min(_BLOCKS, count)
    return np.unique(np.concatenate(parts), return_inverse=True)[1]


def _systematic(lines: Lines, fit: _Fit) -> float:
    """Misfit over its noise, root mean square over all lines; 1 where the noise is not known."""
    ratio = (np.abs(fit.balance.residual) ** 2 / fit.noise.variance)[lines.used]
    ratio = ratio[np.isfinite(ratio)]
    return float(np.sqrt(np.mean(ratio))) if len(ratio) else 1.0


def _relative(lines: Lines, power: Array) -> float:
    """Root mean square of a quantity (r, H+1) [N^2] over that of the force, averaged over the records."""
    force = np.abs(lines.spectra.mean_force) ** 2
    shares = [
        float(one[used].sum() / whole[used].sum())
        for one, whole, used in zip(power, force, lines.used, strict=True)
    ]
    return float(np.sqrt(np.mean(shares)))


def _judge(
    spectra: MultisineSpectra, lines: Lines, law: ForceLaw, model: Model, fit: _Fit
) -> MultisineIdentification:
    part = lines.spectra
    covariance, null, freedom, wider = _errors(lines, fit, model.mass, law)
    misfit = _relative(lines, np.abs(fit.balance.residual) ** 2)
    noise = _relative(lines, fit.noise.variance)
    reasons = _reasons(law, model, null, covariance, fit)
    solution = Solution(fit.values, fit.mass, covariance, freedom, misfit)
    estimates = make_estimates(solution, law, model, reasons)
    approximations = best_linear(part, model.observation.band)
    findings = [e.finding for e in estimates if e.finding is not None]
    findings += _misfit_findings(lines, fit, misfit, noise, wider)
    findings += [*spectra.findings, *([] if fit.converged else [Finding("not-converged", "doubt")])]
    if not model.observation.calibrated:
        findings.append(Finding("not-calibrated", "info"))
    amplitudes = np.sqrt(2) * part.rms_response()
    frequency = part.frequency[lines.used.any(axis=0)]
    levels = part.levels
    numbers = quantities(
        identified=sum(estimate.identifiable for estimate in estimates),
        parameters=len(estimates),
        lines=int(lines.used.sum()),
        records=len(part),
        levels=len(levels),
        misfit=misfit,
    )
    empty = np.zeros(0)
    return MultisineIdentification(
        model=model,
        paper=(),
        first_order=(),
        refined=estimates,
        first_order_bias=(),
        covariance=covariance,
        resonances=tuple(map(_resonance, approximations)),
        curve=EquivalentCurve(empty, empty, empty, empty, empty, empty.astype(bool)),
        residual=misfit,
        noise=noise,
        levels=levels,
        amplitude_range=(float(amplitudes.min()), float(amplitudes.max())),
        frequency_range=(float(frequency[0]), float(frequency[-1])),
        outcome=Finding("identified-from-lines", "info", numbers=numbers),
        findings=tuple(findings),
        solution=fit.values,
        spectra=spectra,
        approximations=approximations,
        used=frozen_array(lines.used, np.bool_),
        misfit=frozen_array(fit.balance.residual, np.complex128),
        deviation=frozen_array(np.sqrt(fit.noise.variance)),
    )


def _resonance(found: BestLinear) -> Resonance:
    """The mode of the best linear approximation of a level."""
    natural = 2 * np.pi * found.natural_frequency
    return Resonance(
        level=found.level,
        sweep="rest",
        frequency=found.natural_frequency,
        damping_ratio=found.damping_ratio,
        amplitude=float(np.sqrt(2) * found.rms),
        stiffness=found.stiffness,
        damping=2 * found.damping_ratio * found.mass * natural,
    )


def _reasons(
    law: ForceLaw, model: Model, null: Array, covariance: Array, fit: _Fit
) -> dict[str, Finding | None]:
    """Why parameters are not identifiable: the others of their null direction, or no effect."""
    names = names_of(law, model)
    reasons: dict[str, Finding | None] = {}
    for i, name in enumerate(names):
        weight = np.abs(null[i])
        if weight.max(initial=0.0) > NULL_PART:
            column = np.abs(null[:, int(np.argmax(weight))])
            others = [
                other for other, part in zip(names, column, strict=True) if part > NULL_PART and other != name
            ]
            about = {"with": ", ".join(others)}
            reasons[name] = Finding("confounded", "warning", name, names=about) if others else None
            continue
        value = fit.mass if name == "m" else float(fit.values[i])
        error = float(np.sqrt(covariance[i, i]))
        if error > 0.5 * abs(value):
            unit = units_of(model)[name]
            numbers = {"value": Quantity(value, unit), "standard_error": Quantity(error, unit)}
            reasons[name] = Finding("line-not-distinct-from-zero", "warning", name, numbers=numbers)
    return reasons


def _misfit_findings(lines: Lines, fit: _Fit, misfit: float, noise: float, wider: float) -> list[Finding]:
    """Judge what the law leaves by its size and by the noise."""
    times = _systematic(lines, fit)
    if not np.isfinite(noise):
        found = [Finding("one-period", "warning")]
        if misfit > _POOR:
            found.append(
                Finding(
                    "law-does-not-fit",
                    severity_of(misfit, _POOR, _MEANINGLESS),
                    numbers=quantities(misfit=misfit),
                )
            )
        return found
    if times < EXCESS:
        if misfit > 2 * _POOR:
            return [
                Finding(
                    "misfit-large",
                    "error" if misfit > _MEANINGLESS else "doubt",
                    numbers=quantities(misfit=misfit),
                )
            ]
        return []
    numbers = quantities(misfit=misfit, times=times, wider=wider, groups=int(_groups(lines).max()) + 1)
    severity = severity_of(misfit, _POOR, _MEANINGLESS)
    return [Finding("law-leaves-distortion", severity, numbers=numbers)]
