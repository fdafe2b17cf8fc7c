"""Repetitions of one kind: enough of them in ``make test``, all of them with ``make test-long`` beside it."""

from collections.abc import Iterable
from typing import Any

import pytest


def every_second_is_long(cases: Iterable[Any]) -> list[Any]:
    """Cases for ``pytest.mark.parametrize``, a tuple where a case has several values."""
    return [pytest.param(*_values(case), marks=pytest.mark.long) if k % 2 else case for k, case in enumerate(cases)]


def _values(case: Any) -> tuple[Any, ...]:
    return case if isinstance(case, tuple) else (case,)
