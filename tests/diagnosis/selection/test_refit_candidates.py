"""What a round of the search shows of its progress."""

import itertools

from frictionjax.diagnosis.selection.refit_candidates import shown_span


def test_every_round_moves_the_bar_on_and_leaves_some_of_it():
    spans = [shown_span(number) for number in range(4)]
    assert spans[0][0] == 0.0 and spans[-1][1] < 1.0
    assert all(stop == later > start for (start, stop), (later, _) in itertools.pairwise(spans))
    # Most searches end with the first round or the second.
    assert 0.6 < spans[0][1] < 0.8
