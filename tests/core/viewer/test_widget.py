"""The viewer in a notebook."""

from __future__ import annotations

import sys

import pytest
from viewed_surfaces import viewed

import modalmotion as mm
from modalmotion.errors import MissingExtraError, ParameterError
from modalmotion.viewer import widget
from modalmotion.viewer.bundle_files import script
from modalmotion.viewer.container import read_container


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_widget_holds_what_the_page_reads() -> None:
    pytest.importorskip("anywidget")
    sequence, signature = viewed("cup")
    shown = mm.view(signature, sequence)
    assert read_container(shown.payload)[0]["sequence_id"] == sequence.id
    assert len(read_container(shown.frames[0])[1]["frames"]) == sequence.n_frames
    assert shown._esm == script()
    fitted = mm.view(sequence, parameters=mm.SignatureParameters(modes=4))
    assert read_container(fitted.payload)[1]["amplitudes"].shape[1] == 4


def test_a_signature_alone_has_no_surface() -> None:
    with pytest.raises(ParameterError, match=r"view\(signature, sequence\)"):
        mm.view(viewed("cup")[1])


def test_without_anywidget_the_command_that_installs_it_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    widget._widget.cache_clear()
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(MissingExtraError, match="pip install anywidget"):
        mm.view(viewed("cup")[0])
    widget._widget.cache_clear()
