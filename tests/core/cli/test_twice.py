"""Every command runs twice in one process."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from dicom_samples import study_instance
from training_cohort import cohort

from modalmotion.cli import main

COMMANDS = main.list_commands(click.Context(main))

# What each does at little cost. These run until they are ended, or cost a training.
LONG = {
    "serve",
    "train",
    "evaluate",
    "features",
    "track",
    "segment",
}
CHEAP = {
    "audit": "show --data-dir {store}",
    "cohort": "{folder} -o {cohort}",
    "keys": "list --data-dir {store}",
    "owners": "list --data-dir {store}",
    "store": "verify {store}",
    "animate": "cup --mode 1,1,cos=0.1 -o {out}.glb",
    "card": "ventricle-simulated",
    "classify": "{beat}",
    "convert": "{beat} {out}.vtkhdf",
    "decode": "{stream} -o {out}.npz",
    "dicom": "{beat} --study {study} --coordinates LPS -o {out}",
    "encode": "{beat} -o {out}.stream --max-error 1",
    "modes": "{beat}",
    "norm": "train {controls} --name ours -o {out}.norm.h5",
    "readouts": "{beat}",
    "reconstruct": "{beat} -o {out}.npz",
    "report": "{beat} -o {out}",
    "signature": "{beat} -o {out}.h5",
    "score": "{beat} {beat}",
    "settings": "",
    "show": "{beat}",
    "simulate": "-o {out}.npz",
    "simulate-cohort": "-o {out} --per-class 1 --seed 1",
    "table": "{beat} -o {out}.csv",
    "tradeoff": "{beat} --tolerance 2",
    "view": "{beat} -o {out}.html",
}


def run(*arguments: str) -> str:
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == 0, f"{arguments}: {done.output}"
    return done.output


@pytest.mark.parametrize("name", COMMANDS)
def test_help_twice(name: str) -> None:
    assert run(name, "--help") == run(name, "--help")


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("twice")
    (folder / "in").mkdir()
    (folder / "in" / "beat.npz").write_bytes(next(cohort(1, seed=3)).body)
    places = {
        "folder": folder / "in",
        "beat": folder / "in" / "beat.npz",
        "store": folder / "store",
        "cohort": folder / "cohort",
        "controls": folder / "controls.csv",
        "stream": folder / "beat.stream",
        "study": folder / "study.dcm",
        "out": folder / "out",
    }
    pytest.importorskip("highdicom")
    places["study"].write_bytes(study_instance())
    bodies = [one.body for one in cohort(5, seed=4)][:9]
    for k, body in enumerate(bodies):
        (folder / f"{k}.npz").write_bytes(body)
    places["controls"].write_text("path\n" + "".join(f"{k}.npz\n" for k in range(9)))
    run("encode", str(places["beat"]), "-o", str(places["stream"]), "--max-error", "1")
    run("cohort", str(places["folder"]), "-o", str(places["store"]))
    run(
        "keys", "create", "--owner", "local", "--scopes", "read", "--data-dir", str(places["store"])
    )
    return places


def test_no_command_is_forgotten() -> None:
    assert CHEAP.keys() | LONG == set(COMMANDS)


@pytest.mark.every(3)
@pytest.mark.parametrize("name", sorted(CHEAP))
def test_a_cheap_job_twice(name: str, places: dict[str, Path]) -> None:
    arguments = CHEAP[name].format(**places).split()
    run(name, *arguments)
    run(name, *arguments)
