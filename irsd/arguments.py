"""The command line of irsd."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from irsd.config import IrsdConfig, find_config, load_config
from irsd.io.keys import check_robot_name


def read_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line; exits with code 2 for a wrong one."""
    parser = argparse.ArgumentParser(
        prog="irsd", description="Builds a live scene graph of a building from a robot's sensors."
    )
    parser.add_argument(
        "--config", type=Path, help="YAML file (default: $IRSD_CONFIG, /etc/irsd/irsd.yaml, built-in values)"
    )
    parser.add_argument("--robot", help="name of the robot")
    parser.add_argument(
        "--endpoint", help="zenoh endpoint to listen on, such as tcp/127.0.0.1:7448 (also $IRSD_ENDPOINT)"
    )
    keep = parser.add_mutually_exclusive_group()
    keep.add_argument("--state", type=Path, help="directory that keeps the map between runs")
    keep.add_argument("--no-store", action="store_true", help="keep nothing on disk")
    parser.add_argument("--log-level", default="info", choices=("debug", "info", "warning", "error"))
    parser.add_argument("--version", action="version", version=f"irsd {metadata.version('irsd')}")
    return parser.parse_args(arguments)


def configured(arguments: argparse.Namespace) -> IrsdConfig:
    """The configuration with the command line's word over it. Raises ConfigError."""
    config = load_config(find_config(arguments.config))
    if arguments.robot:
        config = dataclasses.replace(config, robot=check_robot_name(arguments.robot))
    if arguments.no_store:
        config = dataclasses.replace(config, store=dataclasses.replace(config.store, enabled=False))
    elif arguments.state is not None:
        store = dataclasses.replace(config.store, enabled=True, directory=str(arguments.state))
        config = dataclasses.replace(config, store=store)
    return config
