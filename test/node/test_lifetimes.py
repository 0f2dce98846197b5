"""Starting and stopping, over and over: always the same end, and nothing left behind."""
import random
import signal
import time
from pathlib import Path

import psutil
import pytest

pytest.importorskip('rclpy')
from hpv_twin.recording.reader import describe

SHARED = Path('/dev/shm')
SIGNALS = [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGINT],
           [signal.SIGTERM, signal.SIGINT]]


def shared_files():
    """Files of Fast DDS in shared memory."""
    return {*SHARED.glob('*fastrtps*'), *SHARED.glob('*fastdds*')}


def in_use(path):
    """Whether some process of this machine has the file in its memory; a mutex: its port."""
    if path.name.startswith('sem.'):
        path = SHARED / path.name.removeprefix('sem.').removesuffix('_mutex')
    for process in psutil.process_iter():
        try:
            if str(path) in Path(f'/proc/{process.pid}/maps').read_text():
                return True
        except OSError:
            continue
    return False


def members(group):
    """Processes of a process group that still run."""
    found = []
    for process in psutil.process_iter(['status']):
        try:
            stat = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
        except OSError:
            continue
        if int(stat[2]) == group and stat[0] != 'Z':
            found.append(process.pid)
    return found


def live_and_die(start_twin, rng):
    """One twin, signalled at a random moment."""
    before = shared_files()
    twin = start_twin()
    time.sleep(rng.uniform(0.0, 3.0))
    # A signal before Python has begun is the operating system's: wait for the twin to be there.
    end = time.monotonic() + 30.0
    while not catches_signals(twin.process.pid):
        assert time.monotonic() < end
        time.sleep(0.02)
    for number in rng.choice(SIGNALS):
        twin.signal(number)
        time.sleep(rng.choice([0.0, 0.01, 0.3]) if twin.process.poll() is None else 0.0)
    assert twin.wait(10) == 0, twin.log
    assert 'Traceback' not in twin.log, twin.log
    assert not members(twin.process.pid)
    for path in twin.recordings:
        assert not describe(path).problem
    left = [path for path in shared_files() - before if path.exists() and not in_use(path)]
    assert not left


def catches_signals(pid):
    """Whether a process has a handler for SIGINT and SIGTERM of its own."""
    status = Path(f'/proc/{pid}/status').read_text()
    caught = int(status.partition('SigCgt:')[2].split()[0], 16)
    return all(caught >> (number - 1) & 1 for number in (signal.SIGINT, signal.SIGTERM))


def test_lifetimes(start_twin):
    rng = random.Random(1)
    for _ in range(4):
        live_and_die(start_twin, rng)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_fifty_lifetimes(start_twin):
    rng = random.Random(2)
    for _ in range(50):
        live_and_die(start_twin, rng)
