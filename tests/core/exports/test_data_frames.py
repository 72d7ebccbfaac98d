"""Results as data frames. They need the extra `tables`."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical import clinical_readouts
from modalmotion.errors import MissingExtraError
from modalmotion.exports.tables import frame_table, to_dataframe


def test_a_data_frame_turns_back_into_the_array() -> None:
    pytest.importorskip("pandas")
    sequence, signature = viewed("cup")
    wide = to_dataframe(signature).pivot_table(
        index="frame", columns=["mode", "direction"], values="amplitude"
    )
    flat = signature.amplitudes.reshape(signature.n_frames, -1)
    np.testing.assert_array_equal(wide.to_numpy(), flat)
    frames = to_dataframe(frame_table(signature, clinical_readouts(signature, sequence)))
    assert len(frames) == signature.n_frames


def test_what_is_absent_names_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="pip install pandas"):
        to_dataframe(viewed("cup")[1])
