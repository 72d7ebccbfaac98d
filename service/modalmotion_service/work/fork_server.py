"""The process that workers are forked from, which has imported what tasks need.

It is little that has to be imported to begin it, so that a server begins it first of all and its
imports go on beside the server's own.
"""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing import forkserver
from typing import Final

from modalmotion_service.work.temporary import require_temporary_folder

# Of SciPy what the tasks use, which they import where they use it: a parser that is confined can
# open no file any more, and the first task is to be as quick as the next.
PRELOADED: Final = [
    *(f"scipy.{name}" for name in ("fft", "interpolate", "linalg", "ndimage", "optimize")),
    *("scipy.sparse.csgraph", "scipy.sparse.linalg", "scipy.spatial.transform", "scipy.special"),
    *(
        f"modalmotion_service.work.tasks.{name}"
        for name in (
            *("sequences", "signatures", "templates", "derived"),
            *("codec", "classification", "tracks"),
        )
    ),
]
"""Modules that every worker has from its start."""


THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What says how many threads a product of matrices takes."""


def begin_fork_server() -> None:
    """Begin it, unless it runs.

    Its workers, one for each core, take one thread each, unless the environment says otherwise:
    threads of all would wait for one another, busily, a sixth of all processor time.
    """
    if not any(name in os.environ for name in THREADS):
        os.environ.update(dict.fromkeys(THREADS, "1"))
    # Its folder is named to it.
    require_temporary_folder()
    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    forkserver.ensure_running()
