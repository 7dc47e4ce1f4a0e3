"""Modules that are mutated, each with the tests that belong to it: words for pytest.

Left out with ``-k`` is what is slow with kernels in plain Python.
"""

MODULES: dict[str, tuple[str, ...]] = {
    "arrays": ("tests/test_arrays.py",),
    "timebase": ("tests/test_timebase.py",),
    "units": ("tests/test_units.py",),
    "rotation": ("tests/test_rotation.py",),
    "earth": ("tests/test_earth.py",),
    "frames": ("tests/test_frames.py",),
    "growth.schuler_loop": ("tests/growth/test_forms.py",),
    "mechanization.kernels": (
        *("tests/mechanization/test_kernels.py", "tests/mechanization/test_strapdown.py"),
        *("-k", "test_kernels or constant_turn or series_of or large_turns or second_order"),
    ),
    "filtering.error_model": (
        *("tests/filtering/test_error_model.py", "tests/filtering/test_yaman_matrices.py"),
        *("-k", "not compiled"),
    ),
    "filtering.measurements": ("tests/filtering/test_measurements.py", "-k", "not jacobian"),
    "calibration.bench.gauss_helmert": (
        *("tests/calibration/bench/test_gauss_helmert.py", "-k"),
        "not predicted_covariance and not any_size and not few and not smallest",
    ),
    "characterisation.confidence": (
        *("tests/characterisation/test_confidence.py", "-k"),
        "not coverage and not by_simulation and not chi_square_is_too_low and not can_be_stated and not a_pure "
        "and not greenhall_and_riley",
    ),
    "rotary.modulated_errors": ("tests/rotary/test_modulation.py",),
}
