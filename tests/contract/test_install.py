"""systemd/install.sh, really run below a folder: install, upgrade with edited settings, uninstall, purge."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CONFIG = "etc/irsd/irsd.yaml"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """irsd as a wheel, built of a copy: building leaves files in its source."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("irsd", "nav_bridge"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, source)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-index", "--no-build-isolation"]
    subprocess.run([*command, "-w", str(folder), str(source)], check=True)
    return next(folder.glob("*.whl"))


def install(root: Path, *arguments: str) -> str:
    """Runs the script without network: what irsd needs is what the tests run with."""
    environment = {**os.environ, "DESTDIR": str(root), "PYTHON": sys.executable, "LOCK": "/none"}
    environment |= {"PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1"}
    environment.pop("PYTHONPATH", None)
    command = ["sh", str(ROOT / "systemd/install.sh"), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_install_upgrade_uninstall_purge(tmp_path: Path, wheel: Path) -> None:
    venv = tmp_path / "opt/irsd"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True)  # pip is the tests' own
    packages = next(venv.glob("lib/python3*/site-packages"))
    (packages / "tests_own.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")

    install(tmp_path, str(wheel))
    for name in (CONFIG, "etc/irsd/nav_bridge.yaml", "usr/lib/sysusers.d/irsd.conf"):
        assert (tmp_path / name).is_file()
    for unit in ("irsd.service", "nav-bridge.service"):
        text = (tmp_path / "etc/systemd/system" / unit).read_text()
        assert text == (ROOT / "systemd" / unit).read_text()
        started = next(line for line in text.splitlines() if line.startswith("ExecStart=")).partition("=")[2]
        assert os.access(tmp_path / started.lstrip("/"), os.X_OK)
    assert os.readlink(tmp_path / "usr/local/bin/irsctl") == "/opt/irsd/bin/irsctl"
    said = subprocess.run(
        [str(venv / "bin/irsctl"), "config", "check", str(tmp_path / CONFIG)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == 0, said.stderr
    assert (packages / "irsd").is_dir()

    (tmp_path / CONFIG).write_text("robot: r2\n")
    (tmp_path / "var/lib/irsd/r2").mkdir(parents=True)
    install(tmp_path, str(wheel))
    assert (tmp_path / CONFIG).read_text() == "robot: r2\n"
    assert (tmp_path / (CONFIG + ".new")).read_text() == (ROOT / "config/irsd.yaml").read_text()

    assert "settings are in" in install(tmp_path, "--uninstall")
    assert not venv.exists()
    assert not list((tmp_path / "etc/systemd/system").iterdir())
    assert (tmp_path / CONFIG).read_text() == "robot: r2\n"
    assert (tmp_path / "var/lib/irsd/r2").is_dir()

    install(tmp_path, "--purge")
    left = [path for path in tmp_path.rglob("*") if "irsd" in path.name or "nav" in path.name]
    assert left == []


def test_a_wrong_option_changes_nothing(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="unknown option --unistall"):
        install(tmp_path, "--unistall")
    assert list(tmp_path.iterdir()) == []
