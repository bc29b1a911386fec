"""What a surface has beyond one response at one force: harmonics of the force, a motion across, a base."""

from dataclasses import replace

import h5py
import numpy as np

from rsgen.data.surface import ResponseSurface, save_surface
from rsgen.files import load_surface

FREQUENCY = np.array([8.0, 9.0, 10.0])
RESPONSE = np.array([1e-3, 2e-3 - 1e-3j, 1e-3j])


def surface(**columns) -> ResponseSurface:
    return ResponseSurface(
        **{"level": 2.0, "frequency": FREQUENCY, "force": 2.0, "response": RESPONSE} | columns
    )


def test_the_fundamental_of_recorded_harmonics_is_the_force():
    harmonics = np.array([[0.1, 2, 0.3j], [0.2, 2.1, 0.2], [0.3, 1.9j, 0.1]])
    made = surface(force=harmonics)
    np.testing.assert_array_equal(made.force, harmonics[:, 1])
    np.testing.assert_array_equal(made.force_harmonics, harmonics)
    # a new fundamental keeps its company, new harmonics bring their fundamental
    np.testing.assert_array_equal(replace(made, force=[1, 2, 3]).force_harmonics[:, 1], [1, 2, 3])
    np.testing.assert_array_equal(replace(made, force=[1, 2, 3]).force_harmonics[:, 2], harmonics[:, 2])
    np.testing.assert_array_equal(replace(made, force=2 * harmonics).force, 2 * harmonics[:, 1])
    np.testing.assert_array_equal(made.select(np.array([2, 0])).force_harmonics, harmonics[[2, 0]])


def test_frames_and_files_bring_every_column_back(tmp_path):
    random = np.random.default_rng(1)
    force, response, across = random.normal(size=(3, 3, 4)) + 1j * random.normal(size=(3, 3, 4))
    force[:, 0], across[:, 0], response[:, 0] = force[:, 0].real, across[:, 0].real, response[:, 0].real
    made = surface(force=force, response=response, across=across, per_mass=True, base="velocity")
    save_surface(tmp_path / "s.h5", made)
    read = load_surface(tmp_path / "s.h5")
    framed = ResponseSurface.from_frame(made.to_frame(), per_mass=True, base="velocity")
    for other in (read, framed):
        for name in ("force", "force_harmonics", "harmonics", "across"):
            np.testing.assert_array_equal(getattr(other, name), getattr(made, name))
        assert (other.level_unit, other.force_unit, other.answer_unit) == ("m/s", "m/s^2", "m")
    with h5py.File(tmp_path / "s.h5") as file:
        assert [file[name].attrs["units"] for name in ("level", "force", "across")] == ["m/s", "m/s^2", "m"]
    for words in ("force with 3 harmonics", "motion across", "velocity of the base", "per unit mass"):
        assert words in repr(made)
