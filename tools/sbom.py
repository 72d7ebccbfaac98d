"""Writes what an environment contains as a CycloneDX document: `make sbom`.

Beside the Python packages, which cyclonedx-bom lists with their licences, it names three.js, of
which the viewer's script is built.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]


def main(python: str, folder: str) -> None:
    """Write the document of an environment into a folder."""
    listed = subprocess.run(
        [
            *(sys.executable, "-m", "cyclonedx_py", "environment", python),
            *("--pyproject", str(ROOT / "pyproject.toml"), "--mc-type", "library"),
            "--output-reproducible",
        ],
        check=True,
        capture_output=True,
        text=True,
    )
    document = json.loads(listed.stdout)
    lock = json.loads((ROOT / "viewer" / "package-lock.json").read_text())
    three = lock["packages"]["node_modules/three"]["version"]
    document["components"].append(
        {
            "type": "library",
            "bom-ref": f"three@{three}",
            "name": "three",
            "version": three,
            "purl": f"pkg:npm/three@{three}",
            "licenses": [{"license": {"id": "MIT"}}],
        }
    )
    # Of a checkout that was installed, where it was.
    for one in (document["metadata"]["component"], *document["components"]):
        links = one.get("externalReferences", [])
        one["externalReferences"] = [link for link in links if not link["url"].startswith("file:")]
    path = Path(folder, "modalmotion.cdx.json")
    path.write_text(json.dumps(document, indent=1) + "\n")
    print(f"{path}: {len(document['components'])} components")


if __name__ == "__main__":
    main(*sys.argv[1:])
