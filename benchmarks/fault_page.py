"""The page of the faults: docs/faults.md, whole, as `python -m benchmarks.faults --markdown` prints it."""

from collections.abc import Mapping, Sequence

from benchmarks.fault_case import Row

LONGEST_CELL = 160
HEADS = ("fault", "what was done", "exit", "message", "outside", "half-written", "after", "s", "MB")
TEXT = """\
# Faults put to the commands

Made by `python -m benchmarks.faults --markdown > docs/faults.md`; change the script, not this page. 15 minutes on four
cores; `--quick` kills less often and leaves out the second runs, `--kinds` and `--only NAME` choose rows, `--json`
prints them with every problem found. It ends with exit code 1 where a row is wrong.

Every row is a run of the command line in a folder of its own, with sound inputs to which one thing is done. Computed of
each run, not read off by hand:

- **exit**: 2 (bad input) or 3 (no estimate), of killed ones the signal; 0 where a fault costs one item, with a warning,
  or must not matter. Never a traceback; one message on stderr, which names the place.
- **outside**: names, sizes and hashes of everything outside of the outputs are the same before and after.
- **half-written**: every file of the outputs is whole by its format, and a run that failed left none. What
  `jaxgeo detect` has found so far (`detections.jsonl`) stays: from there it goes on.
- **after**: the same command with the fault gone ends with 0, and its results are byte for byte those of a run that met
  no fault.
- **s**, **MB**: wall time, and the most memory held. What only reads has 6 GiB of addresses and 60 seconds.

What is behind it:

- Outputs are written into a folder (or file) beside their place, brought to disk, and moved there in one step; into a
  folder that exists already, file by file. Killed outright, a process cannot remove that temporary folder. It holds a
  lock that dies with it, so the next run into the same place knows, and removes it. On a file system without locks it
  stays.
- A campaign and a Monte-Carlo study keep what they have done, session by session, and go on from there.
- What is opened must be a file: no device, no pipe. A file that is read whole has at most 1 GiB, a config 4 MiB;
  clouds, bags and databases are read piece by piece. An image may claim 2^28 pixels.
- A full or read-only disk is a small file system (tmpfs) that only the command sees, mounted with `unshare`, as root or
  in a user namespace; where neither is allowed, as on some build machines, the size of files is limited instead.
- An interrupt while Python itself starts meets it before jaxgeo, and looks as Python makes it look: signals are put
  from 30 % of a run's duration on, kills from its start.
"""


def page(rows: Sequence[tuple[str, Row]], kinds: Mapping[str, str], measured: str) -> str:
    """The whole page.

    Args:
        rows: each with its kind.
        kinds: titles of the kinds, in order.
        measured: when and how, in words.
    """
    wrong = [row for _, row in rows if row.problems]
    lines = [TEXT, f"{len(rows)} faults, {len(wrong)} wrong. {measured}"]
    for kind, title in kinds.items():
        of_kind = [row for each, row in rows if each == kind]
        if of_kind:
            lines += [f"\n## {title}\n", f"| {' | '.join(HEADS)} |", "|" + "---|" * len(HEADS)]
            lines += [f"| {' | '.join(_cells(row))} |" for row in of_kind]
    if wrong:
        lines += ["\n## What is wrong\n", *(f"- {row.name}: {'; '.join(row.problems)}" for row in wrong)]
    return "\n".join(lines)


def _cells(row: Row) -> list[str]:
    message = row.message if len(row.message) <= LONGEST_CELL else f"{row.message[:LONGEST_CELL]}…"
    memory = f"{row.rss_mb:.0f}" if row.rss_mb else "-"
    texts = (row.done, row.code, message, row.outside, row.half, row.after, f"{row.seconds:.1f}", memory)
    cells = (("**wrong** " if row.problems else "") + row.name, *texts)
    return [" ".join(cell.replace("|", "/").split()) for cell in cells]
