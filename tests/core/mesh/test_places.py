from __future__ import annotations

import pytest
from facts_samples import PLACE
from hypothesis import given

from modalmotion import ParameterError
from modalmotion.mesh import Place
from modalmotion.mesh.facts import read_place


@given(PLACE)
def test_a_place_comes_back_from_its_text(place: Place) -> None:
    text = ",".join(map(repr, place)) if isinstance(place, tuple) else str(place)
    assert read_place(text) == place


@pytest.mark.parametrize("text", ["", "-1", "1.5", "1,2", "a,b,c", "1,2,3,4", "9" * 400, "1,,2"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="neither a vertex nor a point"):
        read_place(text)
