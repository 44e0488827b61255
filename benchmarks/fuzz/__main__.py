"""Fuzzing for as long as is asked, guided by coverage: `python -m benchmarks.fuzz --target tum --seconds 60`.

`--all` takes every target in turn, each in a process of its own, since libFuzzer ends the process that it runs in. It
begins with the valid files; half of the steps are libFuzzer's own, half those of `mutations`, on what it has found or
on a valid file. What breaks the contract of `target` is written into the folder of `--out`, and nothing else is.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

import typer

_RESULT = "result.json"


def main(
    target: Annotated[list[str] | None, typer.Option(help="Name of a target; may stand several times.")] = None,
    all_targets: Annotated[bool, typer.Option("--all", help="Every target in turn.")] = False,
    seconds: Annotated[int, typer.Option(min=1, help="For each target.")] = 60,
    out: Annotated[Path, typer.Option(help="Folder for files that break a reader.")] = Path("out/fuzz"),
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    markdown: Annotated[bool, typer.Option(help="Print the results as a table of docs/fuzzing.md.")] = False,
) -> None:
    """Fuzz readers, one process each, and print what was tried and found; exit code 1 where something was."""
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("error: fuzzing needs atheris, which is not installed: pip install 'jaxgeo[fuzz]'", file=sys.stderr)
        raise typer.Exit(2) from None
    from benchmarks.fuzz.targets import TARGETS

    names = list(TARGETS) if all_targets else target or []
    unknown = [name for name in names if name not in TARGETS]
    if unknown or not names:
        what = f"no target {', '.join(unknown)}" if unknown else "name a target with --target, or give --all"
        print(f"error: {what}; there are {', '.join(TARGETS)}", file=sys.stderr)
        raise typer.Exit(2)
    rows = []
    for name in names:
        rows.append(_run(name, seconds, out))
        if not as_json and not markdown:
            print(_line(rows[-1]), flush=True)
    if as_json:
        print(json.dumps(rows, indent=1))
    if markdown:
        print("\n".join(_table(rows)))
    if any(row["findings"] for row in rows):
        raise typer.Exit(1)


def _run(name: str, seconds: int, out: Path) -> dict[str, Any]:
    """Fuzz one target in a process of its own."""
    begin_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.fuzz.worker", name, str(seconds), folder]
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, errors="replace", check=False,
            timeout=10 * seconds + 300,
        )  # fmt: skip
        result = Path(folder) / _RESULT
        row = json.loads(result.read_text(encoding="utf-8")) if result.exists() else {"executions": 0}
        crashes = sorted(Path(folder).glob("crashes/*"))
        for crash in crashes:
            kept = out / name / crash.name
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(crash.read_bytes())
        # libFuzzer ends by itself after its time, with code 0; a process that died otherwise is a finding without file.
        died = done.returncode != 0 and not crashes
        words = [line for line in done.stderr.splitlines() if line.strip()]
    return {
        "target": name,
        "executions": row["executions"],
        "refused": row.get("refused", 0),
        "seconds": round(row.get("seconds", time.monotonic() - begin_s), 1),
        "findings": len(crashes) + died,
        "why": row.get("why", []) + ([" ".join(words[-3:])[:300]] if died else []),
    }


def _line(row: dict[str, Any]) -> str:
    words = f"{row['target']:24s} {row['executions']:>9,d} in {row['seconds']:6.1f} s, {row['refused']:>9,d} refused"
    return "\n    ".join([f"{words}, {row['findings']} findings", *row["why"]])


def _table(rows: list[dict[str, Any]]) -> list[str]:
    head = ["| target | files tried | refused | seconds | findings |", "|---|---:|---:|---:|---:|"]
    return head + [
        f"| {row['target']} | {row['executions']:,d} | {row['refused']:,d} | {row['seconds']:.0f} | {row['findings']} |"
        for row in rows
    ]


if __name__ == "__main__":
    typer.run(main)
