"""Which sessions a campaign has, how they are told apart, and when a row is still theirs."""

import os

import pytest
from campaign_inputs import VERSIONS, sessions_of, write_session

from eval.campaign import SHORT_ORDERS, write_platform_sessions
from eval.montecarlo.regimes import regimes_named
from jaxgeo.cli.campaign_sessions import campaign_sessions, config_paths
from jaxgeo.errors import ConfigError, InputError


@pytest.fixture
def folder(tmp_path):
    write_session(tmp_path / "a")
    write_session(tmp_path / "b", name="other")
    (tmp_path / "b" / "rig.yaml").write_text("cameras: {}\n")
    (tmp_path / "b" / ".hidden").mkdir()
    (tmp_path / "b" / ".hidden" / "c.yaml").write_text("sightings: 1\n")
    return tmp_path


def names(paths, folder):
    return [str(path.relative_to(folder.resolve())) for path in paths]


def test_a_folder_gives_its_sessions_and_says_what_it_left_out(folder):
    found, said = config_paths([str(folder)])
    assert names(found, folder) == ["a/poses.yaml", "b/poses.yaml"]
    assert len(said) == 1
    assert "1 YAML file(s) without the key 'sightings' left out: b/rig.yaml" in said[0]


def test_globs_and_lists_and_each_once(folder):
    (folder / "list.txt").write_text("# tonight's\nb/poses.yaml\n\n*/poses.yaml  # all\n")
    found, said = config_paths([str(folder / "list.txt"), str(folder / "a")])
    assert names(found, folder) == ["b/poses.yaml", "a/poses.yaml"]
    assert said == ["2 config(s) were named more than once: each is run once"]


def test_a_broken_config_in_a_folder_is_not_passed_over(folder):
    (folder / "b" / "broken.yaml").write_text("name: [\n")
    found, _ = config_paths([str(folder / "b")])
    assert names(found, folder) == ["b/broken.yaml", "b/poses.yaml"]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("nowhere", "no such file or folder"),
        ("no*where", "no file matches"),
        ("empty", "holds no config of a session"),
        ("list.txt", r"list.txt:2: .*absent.yaml: no such file"),
        ("nothing.txt", "lists no session"),
        ("lists.txt", "names another list"),
    ],
)
def test_what_names_no_session_is_refused(folder, given, message):
    (folder / "empty").mkdir()
    (folder / "list.txt").write_text("a/poses.yaml\nabsent.yaml\n")
    (folder / "nothing.txt").write_text("# none\n")
    (folder / "lists.txt").write_text("list.txt\n")
    with pytest.raises(InputError, match=message):
        config_paths([str(folder / given)])


def test_a_refused_config_stays_with_its_message(folder):
    bad = folder / "b" / "bad.yaml"
    bad.write_text("name: bad\nsightings: {}\n")
    found = sessions_of(bad, folder / "a" / "poses.yaml", out=folder / "out")
    assert found[0].config is None
    assert "bad.yaml" in found[0].refused
    assert found[1].config is not None


def test_sessions_of_one_name_are_told_apart(tmp_path):
    a, b = write_session(tmp_path / "a"), write_session(tmp_path / "b")
    one, other = sessions_of(a, b, out=tmp_path / "out")
    assert one.name == other.name == "small"
    assert one.folder != other.folder
    assert one.key != other.key
    assert [one.folder, other.folder] == [each.folder for each in sessions_of(b, a, out=tmp_path / "out")][::-1]


def test_the_key_follows_config_inputs_and_versions(folder):
    path = (folder / "a" / "poses.yaml").resolve()

    def key(overrides=(), versions=VERSIONS):
        return campaign_sessions([path], overrides, versions, folder / "out")[0].key

    first = key()
    assert key() == first
    assert key(["coarse.scale=false"]) != first
    assert key(versions=VERSIONS | {"jax": "0"}) != first
    track = folder / "a" / "icp.tum"
    os.utime(track, (1.0, 1.0))
    assert key() != first
    second = key()
    path.write_text(path.read_text() + "seed: 4\n")
    assert key() != second


def test_a_malformed_override_is_the_commands_fault(folder):
    with pytest.raises(ConfigError, match="--set coarse: expected key=value"):
        campaign_sessions([folder / "a" / "poses.yaml"], ["coarse"], VERSIONS, folder / "out")


def test_simulated_sessions_of_a_platform_are_sessions_and_short(tmp_path):
    (regime,) = regimes_named("biased")
    configs = write_platform_sessions(tmp_path, regime, 3)
    found, said = config_paths([str(tmp_path)])
    assert (found, said) == ([path.resolve() for path in configs], [])
    sessions = sessions_of(*configs, out=tmp_path / "out")
    assert len({session.name for session in sessions}) == 3
    orders = [session.config.visits.order for session in sessions if session.config is not None]
    assert orders == [list(order) for order in SHORT_ORDERS[:3]]
    before = configs[0].stat().st_mtime_ns
    write_platform_sessions(tmp_path, regime, 4)
    assert configs[0].stat().st_mtime_ns == before
