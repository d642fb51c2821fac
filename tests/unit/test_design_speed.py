"""The study of many designs in its quick form."""

import importlib

import pytest


@pytest.mark.slow
@pytest.mark.usefixtures("on_path")
def test_designs_and_maps():
    study = importlib.import_module("studies.speed.designs")
    rows = study.run(quick=True)
    for row in rows["designs"]:
        assert row["designs"] == row["of"] and not row["failed"] and row["seconds"] > 0
    assert rows["designs"][0]["jumps"] == 12  # up and down, of each
    (only,) = rows["maps"]
    assert only["cusps"] == pytest.approx([1.17011], abs=1e-5) and only["arms"] == 2
    text = study.report(rows)
    assert "| 6 of 6 | spur pair | 12 | 0 |" in text and "| e_scale | 1.1 to 1.2 | 2 |" in text
