"""Tests on real recordings skip where there are none, and fail where they must not skip."""

import pytest
from data_root import data_root


def test_absent_data_skips_loudly(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXGEO_DATA", str(tmp_path / "none"))
    monkeypatch.delenv("JAXGEO_REQUIRE_DATA", raising=False)
    with pytest.raises(pytest.skip.Exception, match="REAL DATA MISSING"):
        data_root()


def test_absent_data_fails_where_it_is_required(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXGEO_DATA", str(tmp_path / "none"))
    monkeypatch.setenv("JAXGEO_REQUIRE_DATA", "1")
    with pytest.raises(pytest.fail.Exception, match="REAL DATA MISSING"):
        data_root()


def test_the_variable_names_the_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXGEO_DATA", str(tmp_path))
    assert data_root() == tmp_path
