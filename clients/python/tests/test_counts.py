"""Counts of a subscription, without a running twin."""

import pytest

from softtwin.subscribe import Subscription


@pytest.mark.parametrize(
    "numbers, lost",
    [
        ([5, 6, 7], 0),
        ([5, 9], 3),
        ([5, 7, 6, 8], 0),
        ([5, 7, 7, 8], 1),
        ([5, 9, 7, 7, 10], 2),
        ([5, 3, 6], 0),
        ([0, 5000, 10, 12, 11, 14], 5000),
    ],
)
def test_each_sample_is_received_or_lost(numbers, lost):
    subscription = Subscription.__new__(Subscription)
    subscription.lost, subscription._last, subscription._first, subscription._came = 0, None, 0, 0
    for number in numbers:
        subscription._count((1, number), None)
    assert subscription.lost == lost
