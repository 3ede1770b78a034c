"""The main job, as a newcomer runs it: three processes on loopback, a graph built while exploring, a goal driven to its end."""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import pytest


@pytest.mark.timeout(290)
def test_the_demo_ends_at_the_television(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "irsd.ctl", "demo", "--detector", "--out", str(tmp_path), "--seed", "4"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr
    reached = re.search(r"^Reached: (0\.\d+) m from I\d+ television in R\d+ laboratory$", run.stdout, re.MULTILINE)
    assert reached, run.stdout[-2000:]
    assert float(reached[1]) <= 0.5
    assert re.search(r"checked against the world's truth: 0\.\d+ m from a television, no collision", run.stdout)
    assert re.search(r"exploring +\d+ % +rooms +\d+ +things +\d+", run.stdout)  # progress was shown
    assert "R1 " in run.stdout  # and the tree
    drawn = {element.tag.rpartition("}")[2] for element in ET.parse(tmp_path / "plan.svg").getroot()}
    assert {"polygon", "text", "image"} <= drawn
    assert cv2.imread(str(tmp_path / "plan.png")) is not None
