"""Laws of which some elements follow the motion across two sensors."""

import numpy as np

import rsgen as rs
from rsgen.data.oscillator import total_force
from rsgen.identification.fitting.across import law_of
from rsgen.law.motion import Motion
from rsgen.law.numeric import compile_law

FORCES = ("k*x + k3*x**3 + c*v", "k*x*0.5 + Fs*sign(v) + masing(Min(kt*x, 2))")
VALUES = np.array([0.3, 1.5, 40.0, 9.0, 7.0])
"""Fs, c, k, k3, kt: the elements share k."""


def test_parts_that_follow_one_motion_add_up_to_the_law_of_all_elements():
    elements = [rs.make_element("a", FORCES[0]), rs.make_element("b", FORCES[1], across="near - far")]
    split, whole = law_of(elements), compile_law(total_force(elements))
    assert (len(split.parts), split.acts_across, split.parameters) == (2, True, whole.parameters)
    assert (len(whole.parts), whole.acts_across) == (1, False)
    motion = Motion(np.array([2.0, 3.0]), np.array([[0, 1.0, 0, 0.2j], [0, 0.4 - 0.1j, 0, 0.05]]))
    waves, step = motion.waveforms(256), motion.interval(256)
    (one,) = whole.sample_parts((waves,), step, VALUES)
    both = split.sample_parts((waves, waves), step, VALUES)
    np.testing.assert_allclose(sum(part.force for part in both), one.force, rtol=1e-12)
    for i, name in enumerate(whole.parameters):
        added = sum(part.by_parameter[i] for part in both)
        np.testing.assert_allclose(added, one.by_parameter[i], rtol=1e-12, atol=1e-12, err_msg=name)
