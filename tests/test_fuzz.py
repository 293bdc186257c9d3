"""A few hundred damaged files; `make fuzz` reads ten thousand."""

from fuzzing import fuzz


def test_no_reader_crashes_hangs_or_raises_what_is_not_ours():
    outcomes, failures = fuzz(cases=360, seed=0)
    assert not [(failure.target, failure.case, failure.what) for failure in failures]
    by_target = {target: {kind for of, kind in outcomes if of == target} for target, _ in outcomes}
    assert len(by_target) == 12
    assert all(kinds - {"read"} for target, kinds in by_target.items() if target != "settings")
