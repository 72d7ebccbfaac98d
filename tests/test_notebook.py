"""The notebook in docs/ is executed."""

from __future__ import annotations

import pytest
from project import ROOT

NOTEBOOK = ROOT / "docs" / "notebook.ipynb"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_every_cell_runs_and_shows_what_it_is_for() -> None:
    # A kernel of its own starts: seconds.
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    for extra in ("ipykernel", "anywidget", "pandas", "xarray", "matplotlib"):
        pytest.importorskip(extra)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "commit it without outputs"
    tasks = "".join(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    assert all(f"**{number}. " in tasks for number in range(1, 11))
    # Of surfaces that are small: what is shown is how.
    small = "akinetic, grid=(12, 64), acquisition=mm.Acquisition(n_frames=13)"
    for cell in notebook.cells:
        cell.source = cell.source.replace(
            "simulate_ventricle(akinetic)", f"simulate_ventricle({small})"
        )
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    shown = [
        set(output.get("data", {})) for cell in notebook.cells for output in cell.get("outputs", [])
    ]
    kinds = set().union(*shown)
    assert {"text/html", "image/png", "application/vnd.jupyter.widget-view+json"} <= kinds
