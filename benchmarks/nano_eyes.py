"""The shipped networks on a recording: what a keyframe of the whole chain costs on one thread, and the memory of all sessions.

    python benchmarks/nano_eyes.py ../shared/data/small_house/small_house_short.mcap

Bars: 120 ms of CPU per 640x480 keyframe (segmenter and the embeddings of all masks, known or not), 250 MB for all sessions.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from irsd.config import IrsdConfig, with_pictures
from irsd.core.types import Detections
from irsd.ctl.recordings import Offline
from irsd.ingest import SensorDecoder
from irsd.perception import meter
from irsd.perception.budget import FULL, BudgetSettings, Rung
from irsd.perception.encoder import LabelEncoder
from irsd.perception.eyes import open_eyes
from irsd.perception.inline import InlineEyes
from irsd.perception.job import PerceptionJob
from irsd.perception.nano import open_namer
from irsd.perception.seer import Runner, Seer
from irsd.pipeline import MapPipeline
from irsd.sensors.replay import read_messages
from irsd.sensors.sync import Synchronizer


class Timed:
    """A chain that notes what each of its keyframes cost."""

    def __init__(self, chain: Seer) -> None:
        self._chain = chain
        self.cancel, self.clear, self.trials, self.dimension = chain.cancel, chain.clear, chain.trials, chain.dimension
        self.ms: list[float] = []
        self.masks: list[int] = []

    def see(self, job: PerceptionJob, rung: Rung, runner: Runner) -> Detections | None:
        """See ``Seer.see``."""
        began_s = time.thread_time()  # one thread: the sessions have no other
        seen = self._chain.see(job, FULL, runner)
        self.ms.append((time.thread_time() - began_s) * 1e3)
        self.masks.append(0 if seen is None else len(seen.number))
        return seen


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    options = parser.parse_args()
    labels, config = LabelEncoder.load(), with_pictures(IrsdConfig())
    memory = meter.MemoryMeter()
    before_mb = memory.rss_mb()
    opened = open_eyes(config.perception, config.models)
    namer = open_namer(config.perception, labels)
    for _, _, run in opened.chain.trials():
        run()
    sessions_mb = memory.rss_mb() - before_mb
    chain = Timed(opened.chain)
    eyes = InlineEyes(chain, BudgetSettings(cpu_cores=16.0), opened.costs)
    pipeline = MapPipeline(config.pipeline, labels, map_id="benchmark", eyes=eyes, namer=namer)
    offline = Offline(SensorDecoder(config.ingest), Synchronizer(config.sync), pipeline, eyes)
    for message in read_messages([options.recording]):
        offline.feed(message)
    offline.finish()
    p50, p95 = np.percentile(chain.ms[2:], (50, 95))
    print(f"keyframes                 {len(chain.ms)}")
    print(f"masks per keyframe        {np.mean(chain.masks):.1f}")
    print(f"CPU ms per keyframe       p50 {p50:.0f}, p95 {p95:.0f}   (bar 120)")
    print(f"memory of all sessions    {sessions_mb:.0f} MB   (bar 250)")
    parts = offline.times.summary().get("parts", {})
    print(f"parts and names           {parts} ms of the map's thread")


if __name__ == "__main__":
    main()
