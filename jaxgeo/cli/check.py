"""`jaxgeo check`: are the visits of a session labelled and surveyed right? Says what is wrong, and changes nothing."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxgeo.cli.check_facts import finding_facts, hypothesis_facts
from jaxgeo.cli.progress import Progress
from jaxgeo.config import load_config
from jaxgeo.config.schema import SessionConfig
from jaxgeo.errors import SightingError, SurveyError
from jaxgeo.io.atomic import check_output_folder

if TYPE_CHECKING:
    from calibration.faults import Alignment, Session
    from jaxgeo.cli.ingest import Ingested
    from jaxgeo.export.table import Table

CHECK_FILE = "check.json"


def check_config(path: Path, out: Path | None, overrides: Sequence[str], quiet: bool) -> bool:
    """Check every trajectory of a session, print what was found and write check.json.

    Returns:
        whether anything is wrong, or the visits are not as many as the order names.

    Raises:
        JaxgeoError: bad input, or visits that do not fix the frame; nothing is written then.
    """
    config = load_config(path, overrides)
    out = Path("out") / config.name if out is None else out
    check_output_folder(out)

    from jaxgeo.cli.run import keep_compiled_programs
    from jaxgeo.cli.session import named
    from jaxgeo.export.json_text import json_text
    from jaxgeo.io.atomic import output_folder

    keep_compiled_programs()
    facts: dict[str, Any] = {}
    with Progress(quiet) as progress:
        progress.phase("read", config.name)
        data, order = visits_as_found(config, progress, out)
        for name in config.trajectories:
            progress.phase("check", name)
            with named(name):
                facts[name] = _check_one(name, config, data, order)
        progress.phase("write", str(out))
        text = json_text({"session": config.name, "simulated": config.simulated, "trajectories": facts})
        with output_folder(out) as temporary:
            (temporary / CHECK_FILE).write_text(text, encoding="utf-8", newline="\n")
    if not quiet:
        _say(config, facts, out)
    return any(found["fault"] for found in facts.values())


def visits_as_found(
    config: SessionConfig, progress: Progress, out: Path | None
) -> tuple["Ingested", tuple[str, ...] | None]:
    """The session's data; where one visit more or fewer was found than the order names, that order too.

    The visits then go by names that mean nothing.

    Raises:
        InputError: as reading for a run; the first reading's error where no order of one name more or fewer fits.
    """
    from jaxgeo.cli.ingest import ingest

    try:
        return ingest(config, progress, out), None
    except SightingError as error:
        order = config.visits.order
        if order is None:
            raise
        for other in (order[:-1], [*order, order[0]]):
            visits = config.visits.model_copy(update={"order": other})
            try:
                return ingest(config.model_copy(update={"visits": visits}), progress, out), tuple(order)
            except SightingError:
                continue  # not this number either; what is said is the first error
        raise error


def _check_one(name: str, config: SessionConfig, data: "Ingested", order: tuple[str, ...] | None) -> dict[str, Any]:
    from calibration.faults import align, find_fault, session_of, site_of
    from jaxgeo.associate import make_anchors, refuse_exchanged_axes
    from jaxgeo.cli.noise import learn_settings, noise_of, stored_noise
    from jaxgeo.cli.session import settings_of
    from jaxgeo.cli.session_corrections import as_recorded

    source, settings = config.trajectories[name], settings_of(config)
    trajectory, origin = data.trajectories[name], data.frame.origin_enh_m
    anchors, said = make_anchors(trajectory, data.sightings, data.visits, data.survey, origin_enh_m=origin)
    recorded = as_recorded(config, "jaxgeo check")
    warnings = [*recorded, *data.made_warnings.get(name, ()), *data.warnings, *said]
    learn = learn_settings(config, source, noise_of(source, config), stored_noise(config, source))
    session = session_of(trajectory, anchors, site_of(data.survey, origin), settings, learn)
    if order is not None:
        return _alignment_facts(config, session, order, align(session, order)) | {"warnings": warnings}
    found = find_fault(session, ordered=config.visits.order is not None)
    if not found.fault:
        # Only now: wrong labels may look like a mirrored survey.
        try:
            refuse_exchanged_axes(trajectory, anchors, scale=settings.coarse_scale, gravity=settings.coarse_gravity)
        except SurveyError as error:
            warnings.append(str(error))
    return finding_facts(config, data.visits, session, found) | {"warnings": warnings}


def _alignment_facts(
    config: SessionConfig, session: "Session", order: Sequence[str], found: "Alignment"
) -> dict[str, Any]:
    from calibration.faults import fault_words
    from jaxgeo.cli.check_mend import order_sentence

    said = [
        f"{len(session.anchors)} visits were found, and the order names {len(order)}.",
        f"Most probable ({_percent(found.probability)}): {fault_words(found.named, order)}.",
        *(f"Not ruled out ({_percent(share)}): {fault_words(h, order)}." for h, share in found.beside),
    ]
    return {
        "fault": True,
        "named": hypothesis_facts(found.named, order) | {"probability": found.probability},
        "not_ruled_out": [hypothesis_facts(h, order) | {"probability": share} for h, share in found.beside],
        "sentences": said,
        "mend": [order_sentence(config, found.named.places) + " Then check again."],
    }


def _percent(share: float) -> str:
    return "over 99.9 %" if share > 0.999 else f"{100.0 * share:.1f} %"


def _say(config: SessionConfig, facts: dict[str, Any], out: Path) -> None:
    from jaxgeo.cli.printed_table import print_table

    label = " (simulated data)" if config.simulated else ""
    for name, found in facts.items():
        for warning in found["warnings"]:
            print(f"warning: {name}: {warning}", file=sys.stderr)
        # Wrong labels bend every prediction: what visits could show is that of the mended session.
        shown = found.get("mended", found)
        if "visits" in shown:
            print_table(_visits_table(f"{name}{label}{', as mended' if 'mended' in found else ''}", shown["visits"]))
        for sentence in (*found["sentences"], *found["mend"]):
            print(f"{name}{label}: {sentence}")
        for sentence in found.get("mended", {}).get("sentences", ()):
            print(f"{name}{label}: Labelled so: {sentence}")
    print(f"{config.name}{label}: {out / CHECK_FILE}")


def _visits_table(name: str, visits: Sequence[dict[str, Any]]) -> "Table":
    import numpy as np

    from jaxgeo.export.table import Column, Table

    rows = [
        (
            v["visit"],
            v["location"],
            float(v["stamp_s"]),
            float(np.linalg.norm(v["surveyed_minus_predicted_m"])),
            f"{v['tail']:.2g}" if np.isfinite(v["tail"]) else None,
            "yes" if v["tested"] else "no",
            float(v["smallest_detectable_shift_m"]),
        )
        for v in visits
    ]
    columns = (
        Column("visit"),
        Column("location", align="left"),
        Column("at", "s", digits=1),
        Column("surveyed from predicted", "m", digits=2),
        Column("probability"),
        Column("position tested", align="left"),
        Column("smallest detectable shift", "m", digits=2),
    )
    return Table(name="visits", title=f"{name}: each visit as the others predict it", columns=columns, rows=tuple(rows))
