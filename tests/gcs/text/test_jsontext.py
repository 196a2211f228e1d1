"""JSON text that every reader takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.text.jsontext import dumps

MIXED = {
    "numbers": [1, -2.5, 3e-07, None],
    "words": ["1", "[\n  2,\n  3\n]", "a"],
    "tables": [[1, 2], [3.5, None]],
    "nothing": [],
    "flags": [True, False],
}


def test_with_an_indent_a_list_of_numbers_stays_on_one_line_and_everything_else_as_it_is() -> None:
    text = dumps(MIXED, indent=2)
    assert json.loads(text) == MIXED
    assert '  "numbers": [1, -2.5, 3e-07, null],\n' in text
    assert "    [1, 2],\n    [3.5, null]\n" in text
    assert '    "a"\n  ],' in text


def test_what_is_not_finite_is_null() -> None:
    values = {"a": np.array([1.0, np.nan]), "b": float("inf"), "c": np.float64(2.5)}
    assert json.loads(dumps(values, indent=2)) == {"a": [1.0, None], "b": None, "c": 2.5}
    assert dumps(values) == '{"a": [1.0, null], "b": null, "c": 2.5}'


def test_keys_that_are_no_text_become_text() -> None:
    assert json.loads(dumps({np.int64(3): {Path("a"): 1.0}})) == {"3": {"a": 1.0}}
    with pytest.raises(TypeError):
        dumps({"a": object()})
