"""The power fails: what was written and not synced is gone.

A library in front of the system's own notes each file as it is when it is synced; these copies are
the disk after the power failed at any later moment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stemwatch.service.collector import Spool
from stemwatch.service.store.store import open_store

SYNCED = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void keep(int handle) {
    char link[64], path[4096], copy[8192], data[65536];
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t length = readlink(link, path, sizeof path - 1);
    const char *disk = getenv("SYNCED_FOLDER");
    if (length <= 0 || !disk) return;
    path[length] = 0;
    snprintf(copy, sizeof copy, "%s/%s", disk, strrchr(path, '/') + 1);
    int from = open(path, O_RDONLY), to = open(copy, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ssize_t count;
    while (from >= 0 && to >= 0 && (count = read(from, data, sizeof data)) > 0)
        if (write(to, data, count) != count) abort();
    close(from);
    close(to);
}

int fsync(int handle) {
    keep(handle);
    return ((int (*)(int))dlsym(RTLD_NEXT, "fsync"))(handle);
}

int fdatasync(int handle) {
    keep(handle);
    return ((int (*)(int))dlsym(RTLD_NEXT, "fdatasync"))(handle);
}
"""
COLLECT = """
import os, sys
from pathlib import Path
import numpy as np
from stemwatch.connectors.modbus.sample_batch import one_instant
from stemwatch.service.collector import Spool
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.config import load_plant
from stemwatch.service.serve.collector_process import StoreWhenReady

folder = Path(sys.argv[1])
spool = Spool(folder / "spool")
forwarder = Forwarder(spool, StoreWhenReady(load_plant(folder / "plant.toml")))
for second in range(20):
    at_us = 1_700_000_000_000_000 + second * 1_000_000
    value = np.array([50.0 + second])
    spool.append(one_instant("plc", ["T"], at_us, value, np.zeros(1, np.uint8), [""]))
    assert forwarder.once()
os._exit(0)  # nothing is tidied up
"""


SPOOL = """
import os, sys
import numpy as np
from stemwatch.connectors.modbus.sample_batch import one_instant
from stemwatch.service.collector import Spool

spool = Spool(sys.argv[1] + "/spool", sync=True)
for second in range(20):
    at_us = 1_700_000_000_000_000 + second * 1_000_000
    value = np.array([50.0 + second])
    spool.append(one_instant("plc", ["T"], at_us, value, np.zeros(1, np.uint8), [""]))
os._exit(0)
"""


def synced_by(program: str, tmp_path: Path) -> Path:
    """The folder of what ``program`` synced."""
    compiler = shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("no C compiler, or not Linux: POWER LOSS IS NOT TRIED")
    source, library = tmp_path / "synced.c", tmp_path / "synced.so"
    source.write_text(SYNCED, encoding="ascii")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    plant, disk = tmp_path / "plant", tmp_path / "disk"
    plant.mkdir()
    disk.mkdir()
    (plant / "plant.toml").write_text("", encoding="utf-8")
    open_store(f"sqlite:///{plant / 'stemwatch.db'}").close()  # was made and synced long ago
    shutil.copy(plant / "stemwatch.db", disk)
    process = subprocess.run(
        [sys.executable, "-c", program, str(plant)],
        env={**os.environ, "LD_PRELOAD": str(library), "SYNCED_FOLDER": str(disk)},
        cwd=plant,
        check=False,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
    return disk


def test_what_the_spool_forgets_is_on_the_disk(tmp_path: Path) -> None:
    """Every sample that was acknowledged is in what was synced of the database."""
    disk = synced_by(COLLECT, tmp_path)
    with open_store(f"sqlite:///{disk / 'stemwatch.db'}") as store:
        samples = store.samples.read("plc", "T")
    assert samples.values.tolist() == [50.0 + second for second in range(20)]


def test_a_spool_that_syncs_keeps_every_sample(tmp_path: Path) -> None:
    """Of a spool with ``sync`` all that was appended is on the disk."""
    disk = synced_by(SPOOL, tmp_path)
    spool = Spool(disk)
    values = [waiting.batch.values.tolist() for waiting in spool.waiting()]
    spool.close()
    assert np.ravel(values).tolist() == [50.0 + second for second in range(20)]
