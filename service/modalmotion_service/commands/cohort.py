"""The command that fits the signatures of a cohort."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.analysis_commands import signature
from modalmotion.cli.options import example, signature_parameters
from modalmotion.cli.outputs import OutputFile, OutputFolder
from modalmotion.cli.store_commands import require_all_packed
from modalmotion.exports.signature_pack import export, is_pack
from modalmotion.formats import ReadOptions
from modalmotion_service.cohort import CohortJob, read_manifest, sign_cohort
from modalmotion_service.environment import read_settings
from modalmotion_service.work.engine import open_engine

_STATED = ("unit", "format", "frame_interval", "n_vertices", "topology", "grid")
_PARAMETERS = (
    *("modes", "kind", "reference", "weights", "merge_vertices", "components", "remove_rotation"),
)

_MOST_PRINTED = 50


@click.command(epilog=example("cohort cases.csv -o results --pack cohort.h5"))
@click.argument("manifest", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=OutputFolder(),
    help="Folder of results; made if missing, continued if not.",
)
@click.option("--scheduler", help="Dask scheduler to send work to, such as tcp://host:8786.")
@click.option("--workers", type=click.IntRange(1, 256), help="Processes here, without one.")
@click.option("--batch", type=click.IntRange(1, 1000), help="Files in one piece of work.")
@click.option(
    "--template-from",
    type=click.Path(exists=True, path_type=Path),
    help="Sequence whose reference frame gives one template for all.",
)
@click.option("--keep-vertices", is_flag=True, help="Keep the sequences too, not only results.")
@click.option(
    "--pack",
    type=OutputFile(),
    help="HDF5 file with them all; one of an earlier run is made anew.",
)
@click.option(
    "--patience",
    default=120.0,
    show_default=True,
    type=click.FloatRange(min=0),
    help="Seconds to wait for a scheduler that is lost.",
)
@click.option(
    "--skip-unreadable", is_flag=True, help="Files that fail do not make the command fail."
)
def cohort(
    manifest: Path,
    output: Path,
    scheduler: str | None,
    workers: int | None,
    batch: int | None,
    template_from: Path | None,
    keep_vertices: bool,
    pack: Path | None,
    patience: float,
    skip_unreadable: bool,
    **options: Any,
) -> None:
    """Fit a signature to every sequence in MANIFEST.

    MANIFEST is a .csv file (columns path, subject, label; the last two may be missing), a .jsonl
    file of such objects, a folder, or a pattern such as 'scans/*.npz'. Given again after an
    interruption, the command does what is unfinished. It ends with 1 if a file failed, unless
    such files are skipped; the others are done then all the same.
    """
    settings = read_settings()
    if workers is not None:
        settings = settings.model_copy(update={"workers": workers, "scheduler": None})
    if scheduler is not None:
        settings = settings.model_copy(update={"scheduler": scheduler})
    stated = {name: options[name] for name in _STATED}
    reading = ReadOptions(limits=settings.read_limits, **stated)
    parameters = signature_parameters(options)
    # That of an earlier run is made anew, as the same command does what failed then.
    if pack is not None and pack.exists() and not is_pack(pack):
        raise click.BadParameter(
            f"{pack} exists already and is not a pack of signatures.", param_hint="--pack"
        )
    job = CohortJob(
        entries=read_manifest(manifest),
        folder=output,
        parameters=parameters,
        options=reading,
        template_from=template_from,
        keep_vertices=keep_vertices,
        batch=batch,
        patience_seconds=patience,
    )
    with click.progressbar(length=len(job.entries), label="signatures", file=sys.stderr) as bar:
        report = sign_cohort(
            job,
            lambda folder: open_engine(settings, folder),
            lambda done, _: bar.update(done - bar.pos),
        )
    click.echo(
        f"{report.n_made} signatures made in {report.seconds:.1f} s, {report.n_known} known "
        f"before, {len(report.failures)} files failed: {output}"
    )
    for path, reason in report.failures[:_MOST_PRINTED]:
        click.echo(f"{path}: {reason}", err=True)
    if len(report.failures) > _MOST_PRINTED:
        click.echo(f"... all of them stand in {output / 'cohort.csv'}", err=True)
    # After the failures of files, which a pack that cannot be written must not hide.
    if pack is not None and (report.n_made or report.n_known):
        packed = export(output, pack, replace=True)
        click.echo(f"{packed.n_signatures} signatures packed: {pack}")
        require_all_packed(packed)
    if report.failures and not skip_unreadable:
        raise click.exceptions.Exit(1)


# Each option of a signature has one definition.
cohort.params += [option for option in signature.params if option.name in (*_STATED, *_PARAMETERS)]
