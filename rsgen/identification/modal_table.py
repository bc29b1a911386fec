"""Identification of a modal table: a mode fitted without a law.

Every point of any test, at any phase, obeys F/X = k(X) - m omega^2 + i sum_j omega^j c_j(X) to first order.
The coefficients of splines for k and c, the mass, amplitude and phase of each point, phase error and
background are fitted by errors-in-variables least squares, as for a law (``fitting``). The shape of the
splines is chosen by the corrected Akaike criterion (Hurvich and Tsai, Biometrika 76, 1989); with a
background, whose error flexible splines would absorb, by BIC. Likely other shapes widen the intervals. The
table covers amplitudes near resonance: elsewhere half a degree of phase error is more than the damping.

The mass follows from points of one amplitude at several frequencies. If all points lie at phase resonance,
k - m omega^2 is zero for every m. Then only k/m = omega^2 and c are identifiable; a lag phi that is not
exactly a quarter period shifts k/m by 2 zeta/tan(phi), with zeta unknown. With a background flexible
splines hardly determine the mass: it is then that of the polynomial law with which the background was found
first, with an error that its misfit widens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import nan

import numpy as np
from numpy.typing import NDArray

import rsgen.identification  # fits of multisines, where one is given
from rsgen.common.arrays import Array
from rsgen.common.errors import RsgenError, known_arguments, require
from rsgen.common.finding import Finding, Quantity, quantities
from rsgen.common.tolerances import (
    ANY_LAW,
    ASSUMED_DAMPING_RATIO,
    COMPARISON_POINTS,
    MAX_ALTERNATIONS,
    MAX_LIGHT_DAMPING_RATIO,
    MISFIT_OF_NOISE,
    RELATIVE_ERROR_DOUBTFUL,
    ROUND_OFF,
    interval_sigmas,
)
from rsgen.data.free_mode import fit_mode, steady
from rsgen.data.multisine.spectra import MultisineSpectra
from rsgen.data.oscillator import Model, Observation, join_model
from rsgen.data.surface.mode_findings import levels_tested
from rsgen.data.surface.plausibility import backbone_gap
from rsgen.data.surface.response_surface import ResponseSurface, typical_amounts, within_half_power
from rsgen.identification.fitting.fit import fit_balance
from rsgen.identification.fitting.forward import ErrorsInVariables
from rsgen.identification.fitting.least_squares import Regression, Rules, fit
from rsgen.identification.fitting.observed import Observed, Problem, is_systematic
from rsgen.identification.fitting.points import (
    LAG_ERROR,
    MIN_POINTS,
    Points,
    amplitudes_near,
    assumed_mass,
    at_phase_resonance,
    at_resonance_alone,
    count_amplitudes,
    held_amplitudes,
    loop_error,
    mass_sure,
    near_resonance,
    per_unit_mass,
    select_points,
)
from rsgen.identification.fitting.repeats import gather_repeats
from rsgen.identification.modal_result import (
    MIN_LIKELIHOOD,
    ModalSplines,
    ModalTable,
    ModalTest,
    ModePoints,
    SplineBasis,
    SplineMode,
    gaps_between,
    holes,
    known_columns,
    scattered,
    table_amplitudes,
)
from rsgen.identification.results.alternatives import Agreement
from rsgen.identification.results.estimates import error_of_mass, state_background
from rsgen.identification.starting.start import start_fit, with_phases
from rsgen.law.motion import feeds_exciter
from rsgen.law.numeric import compile_law

# ----------------------------------------------------------------------------
# Choice of the splines: shapes are compared by linear least squares, one is fitted with noise on both sides.

_SHAPES = ((0, 1), (1, 1), (2, 1), (3, 1), (3, 2), (3, 3), (3, 4), (3, 6), (3, 8), (3, 12), (3, 16))
"""Degrees and numbers of intervals that are tried."""

_POWERS = (0, -1, 1, 2)
"""Powers of the amplitude that are tried as the coordinate of the splines; zero is the logarithm."""

_FIRST_SHAPE = 6
"""Index of the shape with which the orders are chosen first."""

_MIN_FREQUENCY_RATIO = 1.15
"""Highest over lowest frequency from which on the order of the damping shows."""

_DAMPING_POWERS: tuple[tuple[int, ...], ...] = ((1,), (0,), (2,), (0, 1), (1, 2), (0, 1, 2))
"""Orders of the damping that are tried: those of dampers, joints and drag, and their sums."""

_CURVED_DEGREE = 2
"""Degree from which on a spline only approximates k and c."""

_MIN_POINTS_A_COEFFICIENT = 2


@dataclass(frozen=True, slots=True, eq=False)
class ModeProblem:
    """A least-squares problem: parameters are the coefficients of the splines, the mass, the background.

    Parameters
    ----------
    seen
        The points.
    basis, orders
        Splines of k and c_j, and the orders j.
    mass
        Known mass [kg]; NaN if it is fitted.
    assumed
        True if the mass has any value, because only k/m and c are wanted.
    mass_error
        Standard error [kg] of a mass that is held because a background hides it; zero for others.
    others
        Splines of other shapes, and other orders, that fit as well, with their weights.
    """

    seen: ModePoints
    basis: SplineBasis
    orders: tuple[int, ...]
    mass: float
    assumed: bool = False
    mass_error: float = 0.0
    others: tuple[tuple[float, ModalSplines], ...] = ()

    @property
    def observed(self) -> Observed:
        """The points as observed."""
        return self.seen.observed

    @property
    def coefficients(self) -> int:
        """Number of coefficients of all splines."""
        return self.basis.count * (1 + len(self.orders))

    @property
    def count(self) -> int:
        """Number of parameters without the background."""
        return self.coefficients + 1

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask (q,), False for a known mass."""
        free = np.ones(self.count + len(self.observed.background.names), dtype=bool)
        free[self.coefficients] = np.isnan(self.mass)
        return free

    def split(self, parameters: Array) -> tuple[Array, float, Array]:
        """Return coefficients, mass [kg] and background."""
        mass = float(parameters[self.coefficients])
        return parameters[: self.coefficients], mass, parameters[self.count :]

    def solve(self) -> tuple[Array, float]:
        """Solve the linear balance without the background; return parameters, and corrected AIC or BIC."""
        mode = self.seen.mode
        found = fit_mode(
            *steady(mode.force, mode.harmonics[:, 1], mode.omega),
            self.basis(mode.amplitude),
            1 / np.abs(mode.force),
            mass=self.mass,
            orders=self.orders,
        )
        return found.values, self.price(found.misfit**2 / 2, found.unknowns - found.missing)

    def price(self, square: float, used: int) -> float:
        """Return corrected AIC, or BIC with a background, of a mean square of ``used`` parameters."""
        rows = 2 * len(self.seen.mode)
        # few points for many coefficients (Hurvich and Tsai, Biometrika 76, 1989)
        penalty = np.log(rows) if len(self.seen.background) else 2.0
        price = penalty * rows / max(rows - used - 1, 1)
        return float(rows * np.log(max(square, ROUND_OFF**2)) + used * price)


def choose_splines(seen: ModePoints, mass: float) -> ModeProblem:
    """Choose the shape of the splines and the orders of the damping, each by AIC given the other.

    The orders are then chosen again with noise on both sides. With points on one side of the resonance alone
    each order of a sum goes on to it as the shape likes: no sum counts whose shapes leave c there unknown,
    with an interval that contains zero. The approximation error of the chosen splines
    may be as large as the noise, and intervals would not contain it; so the next richer ones are fitted. With
    a background the simplest ones by BIC are fitted.
    """
    mode = seen.mode
    if len(seen.levels):
        # a value of k and c for each: the splines never follow the noise of an amplitude
        allowed, shapes = [_SHAPES[0]], [(*_SHAPES[0], _POWERS[0])]
    else:
        size = mode.amplitude[mode.amplitude >= seen.tested[0]]
        # more amplitudes than coefficients; two amplitudes give a line
        most = min(len(size) // _MIN_POINTS_A_COEFFICIENT, max(count_amplitudes(size) - 1, 2))
        allowed = [s for s in _SHAPES if not s[0] or sum(s) <= most]
        shapes = [(*shape, power) for shape in allowed for power in _POWERS]
    wide = float(mode.omega.max() / mode.omega.min()) > _MIN_FREQUENCY_RATIO
    trials = _DAMPING_POWERS if wide else _DAMPING_POWERS[:1]
    some = seen.select(mode.spread(COMPARISON_POINTS))

    def trial(part: ModePoints, shape: tuple[int, int, int], orders: tuple[int, ...]) -> ModeProblem:
        if len(seen.levels):
            return ModeProblem(part, SplineBasis.steps(seen.levels), orders, mass)
        return ModeProblem(part, SplineBasis.over(part.mode.amplitude, part.tested, *shape), orders, mass)

    @cache
    def price(shape: tuple[int, int, int], orders: tuple[int, ...]) -> float:
        return trial(some, shape, orders).solve()[1]

    shape, orders = (*allowed[min(_FIRST_SHAPE, len(allowed) - 1)], _POWERS[0]), trials[0]
    for _ in range(MAX_ALTERNATIONS):
        before = shape, orders
        orders = min(trials, key=lambda trial_orders: price(shape, trial_orders))
        shape = min(shapes, key=lambda trial_shape: price(trial_shape, orders))
        if before == (shape, orders):
            break
    if len(seen.background):
        return trial(seen, shape, orders)
    # the noise of the response biases the linear solution by more than the orders differ
    priced = [(_weighted_price(one), one) for one in (trial(some, shape, o) for o in trials)]
    priced.sort(key=lambda entry: entry[0])
    others: tuple[tuple[float, ModalSplines], ...] = ()
    for place, (_, best) in enumerate(priced):
        orders = best.orders
        if not len(seen.levels):
            tried = [(price(one, orders), trial(some, one, orders)) for one in shapes]
            others = _fit_shapes(seen, _averaged_shapes(tried))
        if len(orders) == 1 or not others or replace(others[0][1], others=others).damped(seen.near):
            others += _fit_shapes(seen, [one for one in _likely(priced[place:]) if one[1].orders != orders])
            break
    return replace(trial(seen, _next_shape(shape, allowed), orders), others=others)


def _weighted_price(trial: ModeProblem) -> float:
    """Return the corrected AIC of a trial fitted with noise on both sides."""
    found = _fit_values(trial)
    used = int(np.count_nonzero(trial.free))
    return trial.price(found.sigma**2 * found.freedom / (found.freedom + used), used)


def _likely(priced: list[tuple[float, ModeProblem]]) -> list[tuple[float, ModeProblem]]:
    """Return the likely trials with Akaike weights exp(-AIC/2) of sum one."""
    least = min(price for price, _ in priced)
    weighted = [(float(np.exp(0.5 * (least - price))), trial) for price, trial in priced]
    weighted = [entry for entry in weighted if entry[0] > MIN_LIKELIHOOD]
    total = sum(weight for weight, _ in weighted)
    return [(weight / total, trial) for weight, trial in weighted]


def _averaged_shapes(priced: list[tuple[float, ModeProblem]]) -> list[tuple[float, ModeProblem]]:
    """Return the likely of the shapes, which have their AIC or BIC, with their weights.

    If the best is curved, all of them only approximate: the best in each coordinate, with equal weights.
    What one misses is systematic, so that all points count as a single one: its misfit is at most some thirty
    times that of the best.
    """
    best = min(priced, key=lambda entry: entry[0])[1]
    if best.basis.degree < _CURVED_DEGREE:
        return _likely(priced)
    of_power = [[entry for entry in priced if entry[1].basis.power == power] for power in _POWERS]
    ends = [min(entries, key=lambda entry: entry[0]) for entries in of_power]
    near = _likely([(price / len(one.seen.mode), one) for price, one in ends])
    return [(1 / len(near), one) for _, one in near]


def _fit_shapes(
    seen: ModePoints, trials: list[tuple[float, ModeProblem]]
) -> tuple[tuple[float, ModalSplines], ...]:
    """Fit weighted shapes to all points; return them as splines without errors of their own.

    Each is fitted with noise on both sides, as the chosen one: noise of the response biases k, m and c of a
    linear balance, by far more than the shapes differ. Of a fit that does not settle the linear one counts.
    """
    splines = []
    for weight, trial in trials:
        other = replace(trial, seen=seen)
        found = _fit_values(other)
        splines.append((weight, _splines(other, found.parameters if found.converged else other.solve()[0])))
    return tuple(splines)


def _next_shape(shape: tuple[int, int, int], allowed: list[tuple[int, int]]) -> tuple[int, int, int]:
    """Return the next shape after a curved one."""
    degree, intervals, power = shape
    place = allowed.index((degree, intervals))
    if degree < _CURVED_DEGREE:
        return shape
    return (*allowed[min(place + 1, len(allowed) - 1)], power)


def fit_splines(modal: ModeProblem) -> Regression:
    """Fit by maximum likelihood with noise of force and response; errors widened where parts disagree."""
    found, points = _fit_values(modal), modal.observed.points
    misfits = is_systematic(found.residual, points.pairs(found.used))
    return Agreement.of(found, points, found.covariance, misfits=misfits).widen(found)


def _fit_values(modal: ModeProblem) -> Regression:
    """Fit by maximum likelihood, without what the agreement of parts adds to the errors."""
    observed, mode = modal.observed, modal.seen.mode
    descent = ErrorsInVariables(modal, SplineMode(mode.omega, modal.basis, modal.orders))
    nuisance = observed.nuisances(mode.amplitude, np.angle(mode.harmonics[:, 1]))
    start = np.concatenate([modal.solve()[0], modal.seen.background])
    rules = Rules(free=modal.free, record=mode.record, noise=0.0)
    rules = rules.knowing(modal.coefficients, mode.weighed, modal.mass)
    found = fit(descent.linearise, start, nuisance, rules, neighbours=mode.neighbours)
    if found.sigma > MISFIT_OF_NOISE:
        response = descent.predict(found.parameters, found.nuisance)
        descent.scale = np.abs(observed.predict_sensor(response, modal.split(found.parameters)[2]))
        place = found.parameters, found.nuisance, rules
        found = descent.corrected(fit(descent.linearise, *place, used=found.used, neighbours=mode.neighbours))
    return descent.of_deviations(found)


_MAX_POINTS = 800
"""Fitted points, spread over the amplitude."""


@known_arguments
def modal_table(
    surface: ResponseSurface | MultisineSpectra,
    about: Observation | Model | None = None,
    *,
    mass: float | None = None,
    mass_error: float | None = None,
) -> ModalTable:
    """Tabulate resonance frequency, damping ratio, k(X) and c(X) over the amplitude, without a law.

    Parameters
    ----------
    surface
        Settled points of any test; unsettled and held-out ones are not used. Of a multisine the describing
        function of the force that fits all lines is tabulated.
    about
        How the structure was observed: its background is fitted with the mode. Of a model the observation
        and the mass count, not its law.
    mass
        m [kg] if it is known; None: that of the model, or identified from points off resonance. If all
        points lie at phase resonance it is not identifiable, and the table has k/m and c alone.

    Raises
    ------
    RsgenError
        Fewer than four points can be used, or lie near resonance; or the mass is neither given nor
        identifiable, and the points do not lie at phase resonance.

    Examples
    --------
    >>> omega = 2 * np.pi * np.linspace(9, 11, 41)
    >>> mode = 4000 - omega**2 + 2j * omega
    >>> table = modal_table(ResponseSurface(1.0, omega / 2 / np.pi, 1.0, 1 / mode))
    >>> round(float(table.damping_ratio[0]), 5)
    0.01581
    """
    require(surface, (ResponseSurface, MultisineSpectra), "surface")
    model = _model_of(about, mass, mass_error)
    if isinstance(surface, MultisineSpectra):
        return rsgen.identification.table_of_lines(*per_unit_mass(surface, model))
    rows = levels_tested(surface)
    copied = rows.findings[len(surface.findings) :]
    surface, model = per_unit_mass(rows, model)
    means, _ = gather_repeats(surface)
    points = select_points(means, model)
    # without motions across two sensors
    points = replace(points, across=points.across[:, :0])
    # trials may overflow: points that are not finite have no prediction
    with np.errstate(all="ignore"):
        seen = _mode_points(points, model, means.response_held)
        modal = choose_splines(seen, model.fixed.get("m", nan))
        found = fit_splines(modal)
        if seen.first[0] > 0 and _mass_hidden(modal, found):
            modal, found = _with_first_mass(seen)
        elif points.weighed is not None and not _mass_known(modal, found):
            modal, found = _with_first_mass(replace(seen, first=(*points.weighed, 0.0)))
            modal = replace(modal, mass_error=0.0)
        elif not _mass_known(modal, found):
            modal, found = _at_phase_resonance(seen, LAG_ERROR if means.lag_assumed else 0.0)
    if means.lag_assumed:
        found = replace(found, covariance=found.covariance + loop_error(found.influence))
    names = modal.observed.background.names
    more = error_of_mass(model, found.parameters, range(modal.coefficients), names)
    found = replace(found, covariance=found.covariance + more)
    table = _table(modal, found, means, model)
    return replace(table, findings=(*copied, *table.findings))


def _model_of(about: Observation | Model | None, mass: float | None, mass_error: float | None) -> Model:
    """Return mass and observation with the surrogate of any law."""
    require(about, (Observation, Model, type(None)), "about")
    model = about if isinstance(about, Model) else Model(ANY_LAW, observation=about)
    known = Model(ANY_LAW, model.mass, model.observation, mass_error=model.mass_error)
    return join_model(known, mass=mass, mass_error=mass_error)


def _mode_points(points: Points, model: Model, response_held: bool) -> ModePoints:
    """Select the points near resonance, and remove a background fitted with the surrogate of any law."""
    observed = Observed.of(points, model.observation.background)
    mode, background, first = points, np.zeros(0), (nan, nan, nan)
    if not observed.direct:
        problem, start = start_fit(Problem(model.elements, compile_law(model.force), observed, model.fixed))
        found = fit_balance(problem, start, order=1)
        background = found.background
        whole = found.regression
        error = Agreement.of(whole, points, whole.covariance, misfits=True).widen(whole).covariance
        first = found.mass, float(np.sqrt(error[len(found.values), len(found.values)])), whole.sigma
        receptance = observed.background.receptance(background)
        mode = observed.background.subtract(with_phases(points, found, receptance), background)
    near = within_half_power(mode.force, mode.harmonics[:, 1])
    if np.count_nonzero(near) < MIN_POINTS:
        raise RsgenError(
            f"modal table: {np.count_nonzero(near)} points lie within 45 degrees of resonance; "
            f"at least {MIN_POINTS} are needed; where the response jumps past resonance, sweep the other way "
            "or control the phase, or fit a law (rsgen identify, rsgen rank), which needs none there"
        )
    if feeds_exciter(mode.force[near], mode.harmonics[near, 1]):
        raise RsgenError(
            "modal table: near resonance the response leads the force, so that the structure would feed the "
            "exciter; look at the sign, sense and quantity of the response"
        )
    held = held_amplitudes(mode) if response_held else np.full(len(mode), nan)
    size = mode.amplitude if np.isnan(held).any() else held
    tested = float(size[near].min()), float(size[near].max())
    # smaller motions determine the background only
    rows = np.flatnonzero((size >= tested[0]) | bool(len(background)))
    rows = rows[mode.select(rows).spread(_MAX_POINTS)]
    gap = backbone_gap(*at_phase_resonance(mode)) if near_resonance(mode) else None
    if gap is not None and "overlap" in gap.names:
        raise RsgenError(
            f"modal table: points at phase resonance lie near {gap['low']:.4g} and {gap['high']:.4g} Hz, "
            "on the backbones of two modes; a band with one of them is needed"
        )
    return ModePoints(observed, mode, background, tested, held, first).select(rows)


def _mass_hidden(modal: ModeProblem, found: Regression) -> bool:
    """Return True if points off resonance leave a fitted mass a wide interval."""
    place = modal.coefficients
    mass, error = float(found.parameters[place]), float(np.sqrt(found.covariance[place, place]))
    hidden = bool(modal.free[place]) and _is_wide(mass, error, found.freedom)
    return hidden and not at_resonance_alone(modal.seen.mode, found.rms_misfit)


def _is_wide(mass: float, error: float, freedom: int) -> bool:
    """Return True if the interval of a mass [kg] is doubtful; so it is of a negative or unknown one."""
    return not interval_sigmas(freedom) * error < RELATIVE_ERROR_DOUBTFUL * mass


def _with_first_mass(seen: ModePoints) -> tuple[ModeProblem, Regression]:
    """Fit with the mass of the first background held, and add what its error moves to the covariance.

    What the polynomial law leaves beyond the noise of the splines is systematic and does not average out over
    the points: its standard error grows by the ratio of both.
    """
    mass, error, misfit = seen.first
    modal = choose_splines(seen, mass)
    found = fit_splines(modal)
    error *= max(misfit / found.sigma, 1.0)
    moved = _fit_values(replace(modal, mass=mass + error)).parameters - found.parameters
    covariance = found.covariance + np.outer(moved, moved)
    return replace(modal, mass_error=error), replace(found, covariance=covariance)


def _mass_known(modal: ModeProblem, found: Regression) -> bool:
    """Return True if the mass is given, or positive and precise enough."""
    _, mass, _ = modal.split(found.parameters)
    place = modal.coefficients
    if modal.free[place] and at_resonance_alone(modal.seen.mode, found.rms_misfit):
        # only the simplicity of the splines would determine it
        return False
    return mass_sure(mass, float(found.covariance[place, place]))


def _at_phase_resonance(seen: ModePoints, lag_error: float) -> tuple[ModeProblem, Regression]:
    """Fit k/m and c with an assumed mass at phase resonance; ``lag_error`` is that of the lags [rad]."""
    stiffness = seen.mode.force / seen.mode.harmonics[:, 1]
    rows = np.flatnonzero(seen.mode.in_quadrature)
    if len(rows) < MIN_POINTS:
        raise RsgenError(
            f"modal table: the mass is not identifiable, and {len(rows)} points lie at phase resonance, "
            "where it is not needed; give the mass, or measure on both sides of resonance"
        )
    seen = seen.select(rows)
    size = seen.mode.amplitude
    seen = replace(seen, tested=(float(size.min()), float(size.max())))
    modal = choose_splines(seen, assumed_mass(seen.mode, ASSUMED_DAMPING_RATIO))
    found = fit_splines(modal)
    # shift of k/m by a lag that differs from a quarter period, with unknown damping
    square = float(np.mean((stiffness[rows].real / stiffness[rows].imag) ** 2))
    shift = 2 * MAX_LIGHT_DAMPING_RATIO * float(np.sqrt(square + (interval_sigmas() * lag_error) ** 2))
    stiff = np.where(np.arange(len(found.parameters)) < modal.basis.count, found.parameters, 0.0)
    error = np.outer(stiff, stiff) * (shift / interval_sigmas()) ** 2
    modal = replace(modal, assumed=True)
    return modal, replace(found, covariance=found.covariance + error)


def _modal_test(modal: ModeProblem, found: Regression, surface: ResponseSurface, model: Model) -> ModalTest:
    """Return the test as predictions need it."""
    points = modal.observed.points
    part = surface.select(points.index)
    forces = typical_amounts(part)
    if surface.response_held:
        # what each amplitude needs at its resonance
        forces = np.array([np.abs(part.force[part.level == level]).min() for level in part.levels])
    return ModalTest(
        observation=model.observation,
        levels=np.unique(forces),
        frequencies=(float(part.frequency.min()), float(part.frequency.max())),
        level_unit=surface.level_unit,
        units=surface.units,
        background=state_background(
            modal.observed.background,
            modal.observed.points.force,
            modal.observed.points.amplitude,
            modal.split(found.parameters)[2],
            found,
            surface.units,
        ),
        base=surface.base,
    )


def _splines(modal: ModeProblem, parameters: Array, covariance: Array | None = None) -> ModalSplines:
    """Return the splines of some parameters, without errors of their own where none are given."""
    values, mass, _ = modal.split(parameters)
    errors = np.zeros((modal.count,) * 2) if covariance is None else covariance
    # constant below the points: none holds them in the margin for noise
    basis = replace(modal.basis, least=modal.basis.lowest)
    return ModalSplines(basis, modal.orders, values, mass, errors, 2 * len(modal.seen.mode))


def _moved_by_harmonics(modal: ModeProblem, found: Regression) -> Array:
    """Return how the harmonics that one sine neglects move coefficients and mass, a standard error of them.

    They change stiffness and a fitted mass by one factor, and no frequency. With a given mass they change
    k - m omega^2 of points off resonance by that factor: at resonance k is m omega^2.
    """
    share = modal.observed.points.harmonics_share(found.sigma)
    moved, place, mode = np.zeros(modal.count), modal.coefficients, modal.seen.mode
    if modal.free[place] or modal.mass_error:
        together = [*range(modal.basis.count), place]
        moved[together] = float(np.sqrt(np.mean(share**2))) * found.parameters[together]
    elif share.any() and not modal.assumed:
        response = mode.harmonics[:, 1]
        other = replace(mode, force=mode.force + share * (mode.force / response).real * response)
        moved = replace(modal, seen=replace(modal.seen, mode=other)).solve()[0] - modal.solve()[0]
    return moved


def _table(modal: ModeProblem, found: Regression, surface: ResponseSurface, model: Model) -> ModalTable:
    """Evaluate the splines at amplitudes of equal ratio; state the quantities that they do not determine."""
    mass, moved = float(found.parameters[modal.coefficients]), _moved_by_harmonics(modal, found)
    findings: tuple[Finding, ...] = ()
    if modal.assumed:
        numbers = quantities(points=len(modal.seen.mode))
        findings = (Finding("mass-at-resonance", "warning", "m", numbers),)
    elif modal.mass_error:
        wide = _is_wide(mass, modal.mass_error, found.freedom)
        numbers = {"value": Quantity(mass, "kg"), "standard_error": Quantity(modal.mass_error, "kg")}
        names = {"with": "the background"}
        findings = (Finding("confounded", "doubt" if wide else "warning", "m", numbers, names),)
    calibrated, kilogram = model.observation.calibrated, surface.units.kilogram
    known = known_columns(kilogram, calibrated=calibrated, mass=not modal.assumed)
    misfit = found.rms_misfit
    test = _modal_test(modal, found, surface, model)
    findings += () if test.background is None else test.background.findings
    out = np.flatnonzero(surface.held_out(model.observation.hold_out) & surface.settled)
    gaps = gaps_between(modal.seen.near, amplitudes_near(surface.select(out)))
    findings += scattered(misfit) + holes(modal.seen.levels, gaps)
    gap = backbone_gap(*at_phase_resonance(modal.seen.mode)) if near_resonance(modal.seen.mode) else None
    if gap is not None:
        findings += (gap,)
    kilogram = kilogram if calibrated and not modal.assumed else nan
    covariance = found.covariance[: modal.count, : modal.count] + np.outer(moved, moved)
    splines = _splines(modal, found.parameters, covariance)
    splines = replace(splines, freedom=found.freedom, others=modal.others)
    levels = modal.seen.levels
    if len(levels):
        splines = splines.through(levels)
    return ModalTable(
        amplitude=table_amplitudes(modal.seen.tested, levels, gaps),
        splines=splines,
        known=known,
        tested=modal.seen.tested,
        mass=mass * kilogram,
        mass_error=splines.mass_error * kilogram,
        misfit=misfit,
        points=int(np.count_nonzero(found.used)),
        test=test,
        findings=findings,
    )
