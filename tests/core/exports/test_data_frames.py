"""Results as data frames and datasets. Need the extra `tables`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical import clinical_readouts
from modalmotion.errors import MissingExtraError
from modalmotion.exports.tables import frame_table, to_dataframe, to_xarray


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


def test_a_dataset_goes_to_netcdf_and_back_to_equal_bits(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    sequence, signature = viewed("cup")
    dataset = to_xarray(signature, clinical_readouts(signature, sequence))
    assert dataset["amplitude"].dims == ("frame", "mode", "direction")
    assert dataset["amplitude"].attrs["units"] == "mm"
    assert dataset["volume_ml"].attrs["units"] == "ml"
    assert str(dataset["label"].values[1]) == str(signature.modes.labels[1])
    path = tmp_path / "beat.nc"
    dataset.to_netcdf(path, engine="h5netcdf")
    with xarray.open_dataset(path, engine="h5netcdf") as again:
        loaded = again.load()
    assert loaded.attrs == dataset.attrs
    assert loaded["amplitude"].values.tobytes() == signature.amplitudes.tobytes()
    xarray.testing.assert_identical(loaded, dataset)


@pytest.mark.parametrize(("name", "give"), [("pandas", to_dataframe), ("xarray", to_xarray)])
def test_what_is_absent_names_the_command_that_installs_it(
    name: str, give: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=f"pip install {name}"):
        give(viewed("cup")[1])  # type: ignore[operator]
