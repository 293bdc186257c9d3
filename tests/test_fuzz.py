"""A few hundred damaged files; `make fuzz` reads ten thousand."""

from fuzzing import fuzz


def test_no_reader_crashes_hangs_or_raises_an_untyped_error():
    outcomes, failures = fuzz(cases=420, seed=0)
    assert not [(failure.target, failure.case, failure.what) for failure in failures]
    assert len({target for target, _ in outcomes}) == 14
    refused = sum(count for (_, kind), count in outcomes.items() if kind != "read")
    assert 0.2 < refused / 420 < 0.95  # what is never refused, or always, was not damaged as it should be
