"""`jaxgeo campaign`: a row for every session whatever becomes of it, never two, and gone on with after a stop."""

import csv
import json
import os

import pytest
from campaign_inputs import asked, row, run_here, summary_of, write_session

from jaxgeo.cli import campaign_task
from jaxgeo.cli.campaign import TABLE, TABLE_TEXT, run_campaign
from jaxgeo.cli.campaign_cluster import campaign_client, run_tasks
from jaxgeo.cli.campaign_columns import columns
from jaxgeo.cli.campaign_pass import first_tasks
from jaxgeo.cli.campaign_rows import ROWS, attempts_begun, begin_attempt, read_row, write_row
from jaxgeo.cli.campaign_sessions import campaign_sessions
from jaxgeo.cli.campaign_summary import exit_code
from jaxgeo.cli.campaign_task import finished, library_versions, run_task
from jaxgeo.cli.main import main
from jaxgeo.errors import InputError, UndeterminedError


def table(out):
    import pyarrow.parquet as pq

    return pq.read_table(out / TABLE).to_pylist()


def tasks_of(out, *paths, **options):
    versions = library_versions()
    sessions = campaign_sessions([path.resolve() for path in paths], [], versions, out)
    (out / ROWS).mkdir(parents=True, exist_ok=True)
    return first_tasks(asked(out, **options), sessions, out, versions)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two good sessions of one name, a config that is refused, and one whose trajectory is missing."""
    place = tmp_path_factory.mktemp("sessions")
    config = write_session(place / "a")
    write_session(place / "b")
    (place / "b" / "refused.yaml").write_text("name: refused\nsightings: {}\n")
    (place / "a" / "torn.yaml").write_text(
        config.read_text().replace("name: small", "name: torn").replace("icp.tum", "nowhere.tum")
    )
    return place


@pytest.fixture(scope="module")
def done(folder, tmp_path_factory):
    """The campaign over them: its folder and exit code."""
    out = tmp_path_factory.mktemp("campaign") / "out"
    with pytest.MonkeyPatch.context() as patch:
        run_here(patch)
        return out, run_campaign(asked(out, folder))


def test_every_session_has_its_row_and_a_failed_one_only_costs_its_own(done, folder):
    out, code = done
    assert code == 2
    rows = {row["folder"]: row for row in table(out)}
    assert len(rows) == 4
    assert [row["status"] for row in rows.values()].count("ok") == 2
    assert rows["torn"]["exit_code"] == 2
    assert "nowhere.tum: no such file" in rows["torn"]["message"]
    assert "refused.yaml" in rows["refused"]["message"]
    good = [row for row in rows.values() if row["status"] == "ok"]
    assert {row["config"] for row in good} == {str((folder / x / "poses.yaml").resolve()) for x in "ab"}
    assert all(row["n_poses"] == 200 and row["odometry"] == "lidar" and row["attempts"] == 1 for row in good)
    found = summary_of(out)
    assert found["status"] == {"ok": 2, "failed": 2}
    assert {failure["session"] for failure in found["failures"]} == {"torn", "refused"}


def test_columns_are_typed_and_the_text_says_the_same(done):
    import pyarrow.parquet as pq

    out, _ = done
    schema = pq.read_schema(out / TABLE)
    assert schema.names == [column.name for column in columns(pooled=False)]
    assert str(schema.field("n_poses").type) == "int64"
    assert str(schema.field("coarse_rms_m").type) == "double"
    assert str(schema.field("simulated").type) == "bool"
    assert schema.metadata[b"version_jax"].decode() == library_versions()["jax"]
    lines = [line for line in (out / TABLE_TEXT).read_text().splitlines() if not line.startswith("#")]
    for text, typed in zip(csv.DictReader(lines), table(out), strict=True):
        assert text["key"] == typed["key"]
        assert text["coarse_rms_m"] == ("" if typed["coarse_rms_m"] is None else repr(typed["coarse_rms_m"]))


def test_started_again_nothing_is_computed_and_no_cluster_starts(done, folder, monkeypatch, capsys):
    out, _ = done
    before = table(out)

    def none(*_):
        raise AssertionError("a cluster for nothing")

    monkeypatch.setattr("jaxgeo.cli.campaign.campaign_client", none)
    assert run_campaign(asked(out, folder)) == 2
    assert table(out) == before
    assert summary_of(out)["computed_sessions"] == 0
    assert "torn" in capsys.readouterr().err


def test_only_what_changed_is_computed_anew(folder, tmp_path, monkeypatch):
    ran = run_here(monkeypatch)
    good = [folder / "a" / "poses.yaml", folder / "b" / "poses.yaml"]
    assert run_campaign(asked(tmp_path, *good)) == 0
    one = ran[0]
    (tmp_path / ROWS / f"{one.key}.json").write_text('{"key": "torn off')
    assert run_campaign(asked(tmp_path, *good)) == 0
    assert [task.key for task in ran[2:]] == [one.key]
    assert run_campaign(asked(tmp_path, *good, fresh=True)) == 0
    assert len(ran) == 5
    assert len(table(tmp_path)) == 2


def test_the_longest_begin_and_those_of_one_length_follow_each_other(folder, tmp_path, monkeypatch):
    names = ("one", "long", "other", "longer")
    paths = [write_session(tmp_path / name, name) for name in names]
    for name, times in (("long", 2), ("longer", 3)):
        track = tmp_path / name / "icp.tum"
        track.write_text(track.read_text() * times)  # its stamps go back: both are refused, and that at once
    config = paths[2].with_name("lost.yaml")
    config.write_text(paths[2].read_text().replace("name: other", "name: lost").replace("icp.tum", "nowhere.tum"))
    ran = run_here(monkeypatch)
    given = [folder / "b" / "refused.yaml", config, *paths]
    assert run_campaign(asked(tmp_path / "out", *given)) == 2
    assert [task.folder for task in ran] == ["longer", "long", "one", "other", "refused", "lost"]
    assert [row["folder"] for row in table(tmp_path / "out")] == ["refused", "lost", *names]


def test_what_a_killed_worker_left_of_rows_is_removed(folder, tmp_path, monkeypatch):
    run_here(monkeypatch)
    rows = tmp_path / ROWS
    rows.mkdir()
    torn, attempts, new = (rows / name for name in (".a1b2.x_0z.tmp.json", ".a1b2.y_1z.tmp.attempts", ".c.z.tmp.json"))
    other = rows / ".nfs0001"  # not ours
    for path in (torn, attempts, new, other):
        path.write_text("{")
    for path in (torn, attempts, other):
        os.utime(path, (1.0, 1.0))
    assert run_campaign(asked(tmp_path, folder / "b" / "refused.yaml")) == 2
    assert len(list(rows.iterdir())) == 3
    assert {new.name, other.name} < set(os.listdir(rows))


def test_kept_outputs_are_those_of_a_run(folder, tmp_path, monkeypatch):
    ran = run_here(monkeypatch)
    config = folder / "a" / "poses.yaml"
    assert run_campaign(asked(tmp_path, config)) == 0
    assert not (tmp_path / "sessions").exists()
    # Asked for later on, they are made: the row alone is not enough.
    assert run_campaign(asked(tmp_path, config, outputs=True)) == 0
    assert len(ran) == 2
    metrics = json.loads((tmp_path / "sessions" / "small" / "metrics.json").read_text())
    assert metrics["trajectories"]["icp"]["coarse"]["rms_m"] == table(tmp_path)[0]["coarse_rms_m"]


def test_what_a_session_gave_stands_what_befell_its_worker_does_not(tmp_path):
    task = tasks_of(tmp_path, tmp_path / "absent.yaml")[0]
    for status, stands in (("ok", True), ("failed", True), ("timeout", False), ("lost", False)):
        write_row(tmp_path, row(task.key, run="of before", status=status))
        assert (finished(task) is not None) is stands
        write_row(tmp_path, row(task.key, run=task.run, status=status))
        assert finished(task) is not None


def test_a_session_that_loses_its_workers_is_given_up(folder, tmp_path):
    task = tasks_of(tmp_path, folder / "a" / "poses.yaml", retries=1)[0]
    begin_attempt(tmp_path, task.key, "of before")
    assert attempts_begun(tmp_path, task.key, task.run) == 0
    assert [begin_attempt(tmp_path, task.key, task.run) for _ in range(2)] == [1, 2]
    assert run_task(task) == "lost"
    found = read_row(tmp_path, task.key)
    assert found is not None
    assert (found.attempts, found.exit_code) == (2, 3)
    assert "lost 2 times" in found.message


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (UndeterminedError("the anchors are on a line"), "failed", 3),
        (InputError("no such marker"), "failed", 2),
        (RuntimeError("division by cucumber"), "failed", 1),
        (OSError(28, "No space left on device"), "lost", 3),
    ],
)
def test_whatever_goes_wrong_is_said_in_the_row(folder, tmp_path, monkeypatch, error, status, code):
    def fail(*_):
        raise error

    monkeypatch.setattr(campaign_task, "_run", fail)
    task = tasks_of(tmp_path, folder / "a" / "poses.yaml")[0]
    assert run_task(task) == status
    found = read_row(tmp_path, task.key)
    assert found is not None
    assert found.exit_code == code
    assert (getattr(error, "strerror", None) or str(error)) in found.message
    assert os.listdir(tmp_path / ROWS) == [f"{task.key}.json"]


def test_a_worker_with_other_versions_is_refused(folder, tmp_path):
    task = tasks_of(tmp_path, folder / "a" / "poses.yaml")[0]
    task.versions["jax"] = "0.0.1"
    with pytest.raises(InputError, match=r"the command has 0\.0\.1"):
        run_task(task)
    assert read_row(tmp_path, task.key) is None


def test_a_worker_that_ends_costs_only_the_session_it_was_at(folder, tmp_path, monkeypatch):
    """Two real worker processes' lives: the first is ended by the time limit, the next one does the rest."""
    late = tasks_of(tmp_path, folder / "a" / "poses.yaml", limit_s=1e-3)
    other = tasks_of(tmp_path, folder / "b" / "refused.yaml")
    came = []
    for name in ("NPROC", "MALLOC_TRIM_THRESHOLD_"):
        monkeypatch.delenv(name, raising=False)
    with campaign_client(1, None) as client:
        run_tasks(client, [*late, *other], lambda task, status: came.append((task.key, status)))
        # Also of the second: XLA with one thread, and memory that is kept for the next session.
        environment = [client.submit(os.getenv, name).result() for name in ("NPROC", "MALLOC_TRIM_THRESHOLD_")]
    assert environment == ["1", None]
    assert sorted(came) == sorted([(late[0].key, "timeout"), (other[0].key, "failed")])
    found = read_row(tmp_path, late[0].key)
    assert found is not None
    assert "time limit of 0.001 s" in found.message


def test_no_scheduler_there(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("jaxgeo.cli.campaign_cluster.ANSWER_WITHIN_S", 0.5)
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        run_campaign(asked(tmp_path, folder / "a" / "poses.yaml", scheduler="tcp://127.0.0.1:9"))
    assert "0 of 1 sessions are done; the same command goes on" in capsys.readouterr().err


@pytest.mark.parametrize(("library", "module"), [("distributed", "distributed"), ("pyarrow", "pyarrow.parquet")])
def test_without_its_libraries_it_says_how_to_get_them(folder, tmp_path, monkeypatch, library, module):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(InputError, match=rf"needs .*{library}.*pip install 'jaxgeo\[campaign\]'"):
        run_campaign(asked(tmp_path / "out", folder))
    assert not (tmp_path / "out").exists()


def test_the_command_returns_the_gravest_code(folder, tmp_path, monkeypatch, capsys):
    from jaxgeo.cli import main as command
    from jaxgeo.cli.campaign_command import campaign

    run_here(monkeypatch)
    if "campaign" not in {each.name for each in command.app.registered_commands}:
        command.app.command(name="campaign")(campaign)
    assert main(["campaign", str(folder / "a"), "--out", str(tmp_path), "--quiet"]) == 2
    assert main(["campaign", str(folder / "a" / "poses.yaml"), "--out", str(tmp_path)]) == 0
    assert f"1 of 1 sessions: {tmp_path / TABLE}" in capsys.readouterr().out


@pytest.mark.parametrize(("codes", "gravest"), [((), 0), ((3, 2, 3), 2), ((3, 3), 3), ((2, 1, 3), 1)])
def test_a_fault_is_graver_than_bad_input_and_that_than_no_estimate(codes, gravest):
    assert exit_code([{"exit_code": code} for code in codes]) == gravest
