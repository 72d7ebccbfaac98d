from __future__ import annotations

import pytest

from modalmotion.mesh import Named


def test_order_does_not_matter_and_nothing_can_be_put() -> None:
    one, other = Named({"b": 2, "a": 1}), Named({"a": 1, "b": 2})
    assert one == other
    assert hash(one) == hash(other)
    assert list(one) == ["a", "b"]
    assert one != Named({"a": 1})
    # As any mapping is.
    assert one == {"b": 2, "a": 1}
    assert one != {"a": 1}
    assert one != 1
    with pytest.raises(TypeError):
        one["c"] = 3  # type: ignore[index]
