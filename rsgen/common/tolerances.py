"""Numbers that several steps from a surface to a result decide with, each with its reason; and quantiles."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import scipy

from rsgen.common.arrays import Array

ANY_LAW = "k*x + k3*x**3 + k5*x**5 + c*v + c3*v**3 + c5*v**5"
"""Any law at one harmonic, roughly: enough to find phase error and background before a law is tried."""

DEVIATING_MISFIT_RATIO = 3.0
"""Misfit of a level, or a group of points, over that of the others from which it deviates: in sound
structures misfits differ by less than two."""

POINTS_PER_BLOCK = 512
"""Points worked on at once: their sample arrays stay in the processor's cache."""

HELD_OUT_ERROR_SMALL = 0.05
"""Error of held-out responses, relative, up to which it is found only where noise and the errors of values do
not explain it: these grow near the resonance of a level beyond the fitted ones. Sensors are within 5 %."""

HELD_OUT_ERROR_DOUBTFUL = 0.15
"""Error of held-out responses, relative, that is doubtful: most tests are within 15 %."""

HELD_OUT_ERROR_REJECTED = 0.5
"""Error of held-out responses, relative, that is no prediction."""

MAX_ERROR_TO_MISFIT = 2.0
"""Error of a held-out level, relative to the misfit of the fitted levels; noise makes 1.3."""

BRANCH_DISTANCE = 0.2
"""A steady state predicted farther from the measured one, relatively, is on another branch."""

NOISE_LIMIT_SIGMAS = 4.0
"""Standard deviations that chance exceeds to one side once in 30 000: what is farther off is no noise."""

CONFIDENCE_LEVEL = 0.95
"""Probability of every interval and band, between both ends. What is decided by the width of an interval, as
for the mass of a modal table, follows it."""

SIGNIFICANCE_LEVEL = CONFIDENCE_LEVEL
"""Probability with which chance stays nearer to zero than what is called different from it: a value
(``not-distinct-from-zero``), halves of a test, other fits (``is_significant``; ``identify`` asks ratios of
variances)."""

CONFIDENCE_TEXT = f"{100 * CONFIDENCE_LEVEL:g} %"
"""As tables, pages and figures say it."""

INTERVAL_END = (1 + CONFIDENCE_LEVEL) / 2
"""Probability below the upper end of an interval."""

MAX_LIGHT_DAMPING_RATIO = 0.05
"""Damping ratio up to which an unknown one may shift k/m: phase resonance finds lightly damped modes."""

STANDARD_ERRORS_OF_DIFFERENCE = 3.0
"""Standard errors by which a value may differ from another, or from noise: chance brings more once in
400."""

NOISE_RATIO_BY_CHANCE = 1.5
"""Ratio of two estimates of one noise that chance reaches with a few points only."""

ASSUMED_RELATIVE_NOISE = 0.01
"""Relative noise of force and response while none is known."""

MAX_SHARE_OF_OUTLIERS_BY_CHANCE = 0.05
"""Points that are off are chance, or an end of the range, up to this share; a twentieth that is not
explained is none."""

MIN_RELATIVE_SLOPE = 0.05
"""Where force or response grows less than this with the other, both relative, Newton's step is no guide."""

JACKKNIFE_GROUPS = 8
"""Parts of a test that are left out in turn, or scatter: the spread of eight has a known factor of
Student's t, and each is long enough to be correlated in itself."""

MAX_STEP_HALVINGS = 6
"""Of a step that leads to no better point: a sixty-fourth of it is as good as none."""

RELATIVE_ERROR_DOUBTFUL = 0.1
"""An error, a misfit or a shift of a tenth is doubtful, however wide the interval: noise as large hides
what a law does wrong."""

ASSUMED_DAMPING_RATIO = 0.01
"""Damping ratio of a mode while it is not known: it weighs frequency against force."""

RELATIVE_CHANGE_NEGLIGIBLE = 0.01
"""A value that moves by less than a hundredth is the same engineering number."""

MISFIT_DOUBTFUL_PATTERN_UNSEEN = 0.05
"""Doubtful misfit where its pattern cannot be seen (few points, a held phase, lines of a multisine): a
twentieth is more than most noise, joints and sensors leave of a law that is right. From it on no offset is
taken off a multisine (``identify_multisine``). With a pattern the limit
is ``MISFIT_DOUBTFUL_WITH_PATTERN``, without one ``MISFIT_DOUBTFUL_WITHOUT_PATTERN``; beyond
``MISFIT_REJECTED`` each is an error."""

MISFIT_DOUBTFUL_WITH_PATTERN = RELATIVE_CHANGE_NEGLIGIBLE
"""A misfit with a pattern may move values by as much as its size. Of a joint between two sensors the limit
is lower where its motion is small (``misfit_of_joint`` of ``fitting/across``)."""

MISFIT_DOUBTFUL_WITHOUT_PATTERN = RELATIVE_ERROR_DOUBTFUL
"""A misfit that is noise is in the intervals: it is doubtful as an error of a tenth is."""

MISFIT_REJECTED = 0.2
"""A fifth of force and response is not what the law says; truncated waveforms and one harmonic of a law
that is right leave a few per cent. Noise of the lines of a multisine is doubted from here on, but where one
period was recorded."""

FINITE_DIFFERENCE_STEP = 1e-3
"""Relative change by which derivatives of simulated responses are taken; their error is as large."""

NEAR_STEPS = 8
"""Gauss-Newton steps from values that are near, such as those of a law without one more term."""

MISFIT_NEGLIGIBLE = 1e-3
"""Misfits below this, relative, or changes of one, change no engineering number: a law may be as wrong, and
corners and simulations leave as much."""

MISFIT_OF_NOISE = MISFIT_NEGLIGIBLE / 10
"""Above this misfit, relative, it is noise (simulators and truncated waveforms stay below), and the
O(noise^2) bias, a ten-thousandth of it and more, is corrected."""

MAX_LINEAR_CHANGE = 0.5
"""Relative change beyond which derivatives predict nothing any more: near a fold the next half is on another
branch."""

TRIAL_POINTS = 120
"""Points, spread over the amplitude, on which a starting value or a sign is tried."""

COMPARISON_POINTS = 300
"""Points, spread over the amplitude, on which shapes of a curve or sums of terms are compared."""

MIN_NULL_COMPONENT = 1e-3
"""A parameter with a larger part in a null vector is not identifiable; smaller parts are round-off."""

BALANCE_HARMONICS = 9
"""Harmonics of a balance: those beyond are below a hundredth of the third for corners, and less for smooth
laws."""

MAX_SHARE_OF_OUTLIERS = 0.2
"""At most this share of the points is excluded from a fit; if more disagree, it is the law that does not fit.
``soundness`` rejects a result from three quarters of it on. A ranking excludes fewer, at most
``MAX_SHARE_OF_OUTLIERS_BY_CHANCE`` (``candidate_fit.outliers_of``). Two other shares are none of
outliers of a fit: points that a reader leaves out for one reason (``_MAX_SHARE_FOR_ONE_REASON`` of
``tracking``), and readings of one point that are always kept (``_MIN_SHARE_KEPT`` of ``repeats``)."""

MIN_SHARE_PREDICTED = 0.8
"""A law, or a motion, that predicts a smaller share of the points is not compared with others."""

POINTS_PER_KNOT = 8
"""Between two knots of a free curve: they determine its values there, and noise does not show as waves."""

MISFIT_EXPLAINED = 0.05
"""Up to this misfit a reading, a start or a level explains its points, and no other explanation is tried."""

SUBSAMPLE_POINTS = 400
"""Points that suffice to come near the estimate; all points then need one or two steps more."""

MAX_ALTERNATIONS = 3
"""Alternations of a fit and the weights that follow from it: two converge, the third confirms it."""

ROUND_OFF = 1e-12
"""An effect, relative to the largest, that is only round-off of doubles through a thousand operations."""

MAX_SHIFT_TO_ERROR = 0.1
"""Standard errors by which what is left out (harmonics, lines) may move a value."""

MIN_GAIN_OF_STEP = RELATIVE_CHANGE_NEGLIGIBLE**2
"""A step that lowers the sum of squares by less, in units of the noise, moves no parameter by a hundredth of
its standard error."""

SAMPLES_PER_PERIOD = 64
"""A period: exact for polynomials up to the seventh power of nine harmonics."""

SAMPLES_PER_PERIOD_SWITCHED = 4 * SAMPLES_PER_PERIOD
"""A period, where the law has switches: shares of an interval leave an error of its square."""

MIN_LEVELS_FOR_JACKKNIFE = 4
"""Levels from which on most of them speak against one, and their scatter measures an error."""

OUTLIER_SIGMAS = 8.0
"""Standard deviations beyond which a point among any number of them is not where it is by noise."""

MIN_SIGNIFICANT_GAIN = 25.0
"""Gain in the sum of squares, in units of the noise, that a free parameter must bring to be believed: five
standard deviations, a false alarm in two million."""

START_HARMONICS = 3
"""Harmonics while only starting values, phases or a background are sought; the fits that follow find the
rest."""

MAX_NEWTON_STEPS = 50
"""Newton or Gauss-Newton steps: ten are usual; corners of a law, and a law that is not right, need more."""

SPLINE_SMOOTHING = 1e-7
"""Weight of the curvature of a spline: settles it where there are no points, without effect elsewhere."""

HARMONIC_TRUNCATION = 1e-9
"""Relative size at which a last harmonic, or a change of unseen lines, moves no force any more in exact
data."""

MIN_MISFIT_REDUCTION = 0.5
"""A single cause (a term, a background, a delay) that takes up more than this share of a misfit is
there."""

NONLINEAR_TRIALS = 400
"""Values tried of the parameters in which a law is not linear, spread over all their ranges."""

MAX_TRIAL_STEPS = 12
"""Newton or Gauss-Newton steps that show whether a trial leads anywhere: near a solution each doubles the
digits, and a dozen leaves room for steps that had to be shortened."""


def deviation_of_median(median: float) -> float:
    """Return the standard deviation of normal noise from the median of its size, its upper quartile."""
    return median / float(scipy.special.ndtri(0.75))


def samples_for(switched: bool) -> int:
    """Samples a period along which a law is evaluated, with switches or without."""
    return SAMPLES_PER_PERIOD_SWITCHED if switched else SAMPLES_PER_PERIOD


# ----------------------------------------------------------------------------
# Quantiles and tails of the distributions by which fits and intervals are judged.


def normal_share(value: float) -> float:
    """Return the probability that a standard normal number is below a value."""
    return float(scipy.special.ndtr(value))


def interval_sigmas(freedom: Any = inf) -> Any:
    """Return the standard errors to both ends of an interval: the quantile of Student's distribution.

    ``freedom`` are the degrees of freedom of the errors, a number or an array; the default is the normal
    distribution.

    Examples
    --------
    >>> print(f"{interval_sigmas():.3f} {interval_sigmas(4):.3f}")
    1.960 2.776
    """
    return scipy.special.stdtrit(freedom, INTERVAL_END)


def is_significant(value: Any, error: Any) -> Any:
    """Return True where a value with a standard error differs from zero (``SIGNIFICANCE_LEVEL``)."""
    return np.abs(value) > scipy.special.stdtrit(inf, (1 + SIGNIFICANCE_LEVEL) / 2) * error


def f_tail(above: float, below: float, value: float) -> float:
    """Return the probability that a ratio of variances, of these degrees of freedom, exceeds a value."""
    return float(scipy.special.fdtrc(above, below, value))


def f_quantile(above: float, below: float, share: float) -> float:
    """Return what a ratio of variances, of these degrees of freedom, is below with probability ``share``."""
    return float(scipy.special.fdtri(above, below, share))


def chi_square_exceeded(freedom: int, chance: float) -> float:
    """Return what a sum of so many squares of standard normal numbers exceeds with probability ``chance``."""
    return float(scipy.special.chdtri(freedom, chance))


def largest_by_chance(distance: Array, fewest: int, freedom: int, chance: float) -> float:
    """Return the distance that a point exceeds with probability ``chance``.

    Distances follow a scaled chi-square distribution. Its degrees of freedom follow from median and upper
    quartile; harmonics with less noise than the fundamental count little, so that there are few.
    """
    if not len(distance):
        return chi_square_exceeded(freedom, chance)
    middle, upper = np.quantile(distance, [0.5, 0.75])

    def spread(count: int) -> float:
        return chi_square_exceeded(count, 0.25) / chi_square_exceeded(count, 0.5)

    free = next((count for count in range(freedom, fewest, -1) if spread(count) * middle >= upper), fewest)
    return float(middle) * chi_square_exceeded(free, chance) / chi_square_exceeded(free, 0.5)
