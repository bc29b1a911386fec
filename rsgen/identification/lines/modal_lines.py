"""The modal table of a multisine: the describing function of a force that fits the lines of all records.

Forces linear in their coefficients p, powers and switches of x and v, are fitted as a law is (``line_fit``);
the one with the lowest Akaike criterion is taken. Along a sine of amplitude X each has a describing
function, so that k(X) and c(X) are linear in p, and so are the splines of the table through them. The motion
of a multisine has every amplitude up to its peaks: the table needs no test at single amplitudes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from rsgen.common.arrays import Array, ComplexArray
from rsgen.common.errors import RsgenError
from rsgen.common.finding import Finding, quantities
from rsgen.common.tolerances import (
    MIN_MISFIT_REDUCTION,
    RELATIVE_CHANGE_NEGLIGIBLE,
    ROUND_OFF,
    SAMPLES_PER_PERIOD_SWITCHED,
)
from rsgen.data.multisine.spectra import MultisineSpectra, check_records
from rsgen.data.oscillator import Model
from rsgen.formula.reading import parse
from rsgen.identification.fitting.least_squares import Regression
from rsgen.identification.fitting.points import mass_sure
from rsgen.identification.lines.line_balance import select_lines
from rsgen.identification.lines.line_fit import LineFit, fit_lines, misfit_to_noise, start_values
from rsgen.identification.lines.line_identification import fitted_background, lines_feed_exciter
from rsgen.identification.modal_result import (
    MIN_LIKELIHOOD,
    ModalSplines,
    ModalTable,
    ModalTest,
    SplineBasis,
    known_columns,
    scattered,
    table_amplitudes,
)
from rsgen.identification.results.estimates import error_of_mass
from rsgen.law.motion import Motion, project
from rsgen.law.numeric import compile_law

_SPRINGS = ("k1*x", "k3*x**3", "k5*x**5", "k7*x**7")
_DAMPERS = ("c1*v", "c3*v**3", "c5*v**5")
_SWITCHES = ("c2*v*abs(v)", "c0*sign(v)", "k2*x*abs(x)")
"""Drag, friction and springs like x|x|, which few powers do not make up."""

_KNOTS = (0.2, 0.4, 0.6, 0.8)
"""Corners of a spring of straight pieces, relative to the largest displacement."""

_MAX_MISFIT_TO_NOISE = 1.05
"""Misfit over noise of powers up to which switches are not tried."""

_LINE_SHAPE = {"degree": 3, "intervals": 6, "power": 0}
"""Of the splines of a describing function, which is known everywhere, without noise."""

_DESCRIBED_AMPLITUDES = 100
_MARGIN = 1 + RELATIVE_CHANGE_NEGLIGIBLE
"""Factor of the amplitudes beyond the tested ones."""


def _fit_force(spectra: MultisineSpectra, model: Model, *terms: str) -> tuple[float, LineFit]:
    """Fit the sum of some terms; return it with its AIC."""
    law = compile_law(parse(" + ".join(terms)))
    # along the motion as recorded: lines beyond it, that follow from a law, are small and cost much
    lines = select_lines(spectra, model, switched=False)
    found = fit_lines(lines, law, model.fixed, *start_values(lines, law, model.fixed))
    rows = 2 * int(lines.used.sum())
    return rows * np.log(max(found.misfit**2, ROUND_OFF**2)) + 2 * int(found.free.sum()), found


def _scattered(spectra: MultisineSpectra, model: Model, found: LineFit) -> tuple[Finding, ...]:
    """Find lines that depart from one k(X) and c(X), and whether an even force does it."""
    findings = scattered(found.misfit)
    if findings:
        _, even = _fit_force(spectra, model, *_SPRINGS, *_DAMPERS, "e2*x**2")
        if even.misfit < MIN_MISFIT_REDUCTION * found.misfit:
            numbers = quantities(misfit=found.misfit, left=even.misfit)
            return (replace(findings[0], numbers=numbers, names={"even": "x**2"}),)
    return findings


def _fit_forces(spectra: MultisineSpectra, model: Model) -> list[tuple[float, LineFit]]:
    """Fit forces of more and more terms; return each with its AIC, the lowest first."""
    fitted = partial(_fit_force, spectra, model)

    def lowest(tried: list[tuple[float, LineFit]]) -> int:
        return min(range(len(tried)), key=lambda place: tried[place][0])

    tried = [fitted(*_SPRINGS[:count], _DAMPERS[0]) for count in range(1, len(_SPRINGS) + 1)]
    # one more than the lowest criterion asks for: the intervals hold what a poorer force would miss
    springs = _SPRINGS[: lowest(tried) + 2]
    tried += [fitted(*springs, *_DAMPERS[:count]) for count in range(2, len(_DAMPERS) + 1)]
    if misfit_to_noise(tried[lowest(tried)][1]) > _MAX_MISFIT_TO_NOISE:
        motion = Motion(np.full(len(spectra), spectra.omega0), spectra.mean_response)
        reach = float(np.abs(motion.waveforms(4 * spectra.force.shape[2])[0]).max())
        corners = (float(share * reach) for share in _KNOTS)
        pieces = (f"h{i}*(Max(x - {at!r}, 0) + Min(x + {at!r}, 0))" for i, at in enumerate(corners))
        tried += [fitted(*springs, _DAMPERS[0], switch) for switch in (*_SWITCHES, " + ".join(pieces))]
    return sorted(tried, key=lambda entry: entry[0])


def _splines(
    found: LineFit, basis: SplineBasis, size: Array, errors: Regression | None = None
) -> ModalSplines:
    """Return splines through the describing function of a force, with the covariance of its coefficients."""
    # stiffness comes from x alone, whatever the frequency
    stiff = _describing(found, size, np.ones(len(size))).real
    omega = np.sqrt(np.maximum(stiff @ found.values, ROUND_OFF) / found.mass)
    damp = _describing(found, size, omega).imag / omega[:, None]
    shape = np.linalg.pinv(basis(size))
    splines = np.zeros((2 * basis.count + 1, len(found.parameters)))
    count = len(found.values)
    splines[:-1, :count], splines[-1, count] = np.concatenate([shape @ stiff, shape @ damp]), 1.0
    values, covariance = (splines @ found.parameters)[:-1], np.zeros((len(splines),) * 2)
    if errors is None:
        return ModalSplines(basis, (1,), values, found.mass, covariance, 1)
    covariance = splines @ errors.covariance @ splines.T
    return ModalSplines(basis, (1,), values, found.mass, covariance, int(errors.error_freedom.min()))


def _refuse_unsound(found: LineFit, variance: float) -> None:
    """Raise an RsgenError for energy that the exciter would receive, and a mass of no sure sign [kg^2]."""
    if lines_feed_exciter(found):
        raise RsgenError(
            "modal table: the response leads the force, so that the structure would feed the exciter; look "
            "at the sign, sense and quantity of the response"
        )
    if not mass_sure(found.mass, variance):
        error = float(np.sqrt(variance))
        raise RsgenError(
            f"modal table: the mass of the lines is {found.mass:.3g} kg with a standard error of {error:.2g} "
            "kg; give the mass, or look at the signs of force and response"
        )


def table_of_lines(spectra: MultisineSpectra, model: Model) -> ModalTable:
    """Tabulate the describing function of the force that fits the lines of periodic records."""
    spectra = spectra.select(np.flatnonzero(~check_records(spectra, model.observation)))
    with np.errstate(all="ignore"):
        tried = _fit_forces(spectra, model)
        least, found = tried[0]
        amplitudes = np.sqrt(2) * found.mode.spectra.rms_response()
        tested = float(amplitudes.min()), float(amplitudes.max())
        ends = tested[0] / _MARGIN, tested[1] * _MARGIN
        size = np.geomspace(*ends, _DESCRIBED_AMPLITUDES)
        basis = SplineBasis.over(size, ends, **_LINE_SHAPE)
        errors, names = found.errors[0], found.lines.background.names
        more = error_of_mass(model, found.parameters, found.law.linear, names)
        errors = replace(errors, covariance=errors.covariance + more)
        variance = float(np.diag(errors.covariance)[len(found.values)])
        _refuse_unsound(found, variance)
        weights = np.array([np.exp(-0.5 * (price - least)) for price, _ in tried])
        others = [
            (float(weight / weights.sum()), _splines(other, basis, size))
            for weight, (_, other) in zip(weights, tried, strict=True)
            if weight > MIN_LIKELIHOOD
        ]
        splines = replace(_splines(found, basis, size, errors), others=tuple(others[1:]))
        findings = _scattered(spectra, model, found)
    calibrated = model.observation.calibrated
    kilogram = spectra.units.kilogram if calibrated else np.nan
    return ModalTable(
        amplitude=table_amplitudes(tested),
        splines=splines,
        known=known_columns(kilogram, calibrated=calibrated),
        tested=tested,
        mass=found.mass * kilogram,
        mass_error=splines.mass_error * kilogram,
        misfit=found.misfit,
        points=int(found.lines.used.sum()),
        test=ModalTest(
            observation=replace(model.observation, hold_out=()),
            levels=spectra.levels,
            frequencies=found.lines.band,
            level_unit=spectra.level_unit,
            units=spectra.units,
            background=fitted_background(found, errors),
        ),
        findings=findings,
    )


def _describing(found: LineFit, size: Array, omega: Array) -> ComplexArray:
    """Return the dynamic stiffness (n, p) of each coefficient along sines of amplitudes X [m]."""
    motion = Motion(omega, size[:, None] * np.array([0.0, 1.0]) + 0j)
    sample = found.law.along(motion, found.values, SAMPLES_PER_PERIOD_SWITCHED)
    return np.stack([project(force, 1) for force in sample.by_parameter], axis=1) / size[:, None]
