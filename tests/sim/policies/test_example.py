"""The example of training in sim/placement/README.md, with a small budget."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[3] / "sim" / "placement" / "README.md"


@pytest.mark.soak
def test_the_example_trains_and_compares(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3 (make rl)")
    code = re.search(r"```py\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    lines = [line for line in code[1].splitlines() if line]
    assert len(lines) <= 10
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec("\n".join(lines).replace("20_000", "5_000").replace("5010", "5006"), names)
    # 5,000 decisions are too few for a policy that is better than random goals: what is trained is read, played and compared.
    assert "difference from static" in capsys.readouterr().out
    assert (tmp_path / "runs" / "ppo" / "curve.csv").read_text(encoding="utf-8").count("\n") > 1
    rows = names["table"](names["results"])
    assert list(rows) == ["static", "ppo:runs/ppo/policy.onnx"]
    assert all(row["information"].mean > 0 for row in rows.values())
