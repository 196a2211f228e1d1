"""Work on two threads comes back in order, with the first error, and may ask for more of it."""

from __future__ import annotations

import sys
import threading
import time
import warnings

import numpy as np
import pytest

from sysid.numerics.parallel import begun, side_by_side


def test_results_come_in_the_order_of_the_arguments_from_two_threads() -> None:
    both = threading.Barrier(2, timeout=10.0)

    def slow(a: int, b: int) -> int:
        if a < 2:
            both.wait()  # passes only where two work at once
        return 10 * a + b

    assert side_by_side(slow, range(4), range(4)) == [0, 11, 22, 33]


def test_the_first_error_in_their_order_is_raised_whichever_thread_was_first() -> None:
    def fails(a: int) -> int:
        time.sleep(0.2 if a == 0 else 0.0)
        raise ValueError(f"number {a}")

    with pytest.raises(ValueError, match="number 0"):
        side_by_side(fails, range(4))
    assert side_by_side(abs, (-1, -2, -3)) == [1, 2, 3]  # and the next work finds the threads as they were


def test_a_single_piece_is_worked_on_where_it_is_asked_for() -> None:
    assert side_by_side(lambda _: threading.get_ident(), (0,)) == [threading.get_ident()]


def test_work_side_by_side_may_ask_for_more_of_it() -> None:
    found = side_by_side(lambda a: sum(side_by_side(lambda b: a * b, (1, 2, 3))), range(4))
    assert found == [0, 6, 12, 18]


def test_what_was_begun_goes_on_beside_the_block_and_gives_its_result_or_its_error() -> None:
    before = sys.getswitchinterval()
    heard = threading.Event()
    with begun(lambda: heard.wait(10.0)) as ahead:
        heard.set()
        assert ahead.result() is True
    assert sys.getswitchinterval() == before
    with begun(lambda: 1 // 0) as ahead, pytest.raises(ZeroDivisionError):
        ahead.result()


def test_an_interrupt_ends_all_work_and_no_other_error_hides_it() -> None:
    begun_pieces: list[int] = []
    both = threading.Barrier(2, timeout=10.0)

    def piece(a: int) -> None:
        begun_pieces.append(a)
        if a < 2:
            both.wait()
            raise ValueError("an error") if a == 0 else KeyboardInterrupt
        time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        side_by_side(piece, range(50))
    assert len(begun_pieces) < 10


def test_both_threads_handle_overflows_as_the_caller_does() -> None:
    both = threading.Barrier(2, timeout=10.0)

    def overflow(a: int) -> float:
        if a < 2:
            both.wait()
        return float(np.float64(1e300) * np.float64(1e300))

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error")
        assert side_by_side(overflow, range(4)) == [np.inf] * 4


def test_of_two_that_overlap_the_last_sets_the_interval_back() -> None:
    before = sys.getswitchinterval()
    first, second = begun(int), begun(int)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert sys.getswitchinterval() < before
    second.__exit__(None, None, None)
    assert sys.getswitchinterval() == pytest.approx(before)
