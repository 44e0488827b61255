"""Bad input through the command line: the exit code, one message that names place and mend, and nothing written."""

import re

import pytest
from cli.bad_input.cases import CASES
from cli.bad_input.runs import run, snapshot


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_bad_input_is_one_message_and_writes_nothing(case, session, capsys):
    case.spoil(session)
    before = snapshot(session)
    assert run(session, case.session, *case.set_) == case.code
    out, message = capsys.readouterr()
    assert out == ""
    assert message.startswith("error: ")
    assert message.count("error: ") == 1
    assert "Traceback" not in message
    for pattern in case.says:
        assert re.search(pattern, message), f"{pattern!r} is not in {message!r}"
    assert snapshot(session) == before


def test_the_cases_are_many_and_their_names_are_unique():
    assert len({case.id for case in CASES}) == len(CASES) > 100


@pytest.mark.parametrize("id", ["empty-icp.tum", "one-step", "collinear"])
def test_a_failing_run_leaves_an_older_result_as_it_was(session, metrics, id):
    metrics()
    case = next(case for case in CASES if case.id == id)
    case.spoil(session)
    before = snapshot(session)
    assert run(session, case.session, *case.set_) == case.code
    assert snapshot(session) == before
