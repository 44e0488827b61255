"""What can be wrong with the config and with `--set`."""

from cli.bad_input.case import bad, with_set
from cli.spoil import BOMB, content, replace

CONFIG = [
    with_set(
        "unknown-key", "poses", "coarse.scal=true", r"poses\.yaml: coarse: unknown key 'scal'; did you mean 'scale'\?"
    ),
    with_set("wrong-type", "poses", "coarse.scale=3", r"poses\.yaml: coarse\.scale: found 3; expected true or false"),
    with_set("negative-gap", "poses", "visits.gap_s=-1", r"poses\.yaml: visits\.gap_s: found -1; .*greater than 0"),
    with_set("nan-in-config", "poses", "anchors.extra_sigma_m=.nan", r"anchors\.extra_sigma_m: found nan; .*finite"),
    with_set("set-without-value", "poses", "coarse.scale", "--set coarse.scale: expected key=value"),
    with_set("set-below-a-text", "poses", "name.x=3", "--set name.x=3: name is 'small', which has no keys"),
    with_set("set-not-yaml", "poses", "survey=[", r"--set survey=\[: the value is not YAML: line 1, column 2"),
    with_set(
        "data-unset", "poses", "survey.file=${JAXGEO_DATA}/x.csv", r"survey\.file: .*JAXGEO_DATA is not set: set it"
    ),
    with_set("no-trajectory", "poses", "trajectories={}", r"poses\.yaml: trajectories: expected at least one entry"),
    with_set(
        "rotation-unused", "poses", "anchors.use_rotation=true", r"anchors\.use_rotation is on, but none", "false"
    ),
    bad(
        "key-twice",
        "poses",
        replace("poses.yaml", "crs: EPSG:2169", "crs: EPSG:2169\ncrs: local"),
        r"poses\.yaml: line 3, column 1: the key 'crs' stands twice",
    ),
    bad("yaml-bomb", "poses", content("poses.yaml", BOMB), r"poses\.yaml: line 3, column \d+: more than 10 aliases"),
    bad(
        "yaml-tab",
        "poses",
        replace("poses.yaml", "    file: icp", "\tfile: icp"),
        r"poses\.yaml: line \d+, column 1: .*'\\t'",
    ),
    bad("yaml-code", "poses", content("poses.yaml", "a: !!python/none x\n"), "line 1, column 4: the tag .* remove it"),
    bad("yaml-list", "poses", content("poses.yaml", "- a\n"), r"poses\.yaml: holds list; expected a mapping"),
]
