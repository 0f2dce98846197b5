"""A twin that is killed at any moment leaves a recording that everybody can read."""
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from hpv_twin.recording.reader import describe
from hpv_twin.recording.recover import main as recover
from hpv_twin.recording.summary import RecordingError

MOST_LOST = 500_000_000  # ns


def rerun_check(path):
    """Have rerun's own tool look at a file, where rerun is installed."""
    try:
        import rerun_cli
    except ImportError:
        return
    done = subprocess.run([Path(rerun_cli.__file__).with_name('rerun'), 'mcap', 'check', path],
                          capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def has_begun(twin):
    """Whether the first messages are in a file; for an instant it is there and empty."""
    try:
        return bool(twin.recordings and describe(twin.recordings[0]).messages)
    except RecordingError:
        return False


def killed(start_twin, seconds, *parameters):
    """Kill a twin so many seconds after its recording began; what was lost, ns."""
    twin = start_twin(*parameters)
    end = time.monotonic() + 60.0
    while not has_begun(twin):
        assert time.monotonic() < end, twin.log
        time.sleep(0.02)
    time.sleep(seconds)
    twin.signal(signal.SIGKILL)
    at = time.time_ns()
    assert twin.wait() == -signal.SIGKILL
    path = twin.recordings[0]
    about = describe(path)
    assert not about.complete and about.metadata['parameter.publish_rate'] == '1000.0'
    assert about.topics['/hpv_twin/pump_flow'].count == 1
    assert recover([str(path)]) == 3
    copy = path.with_name(f'{path.stem}_recovered.mcap')
    with open(copy, 'rb') as file:
        count = sum(1 for _ in make_reader(
            file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert count == about.messages
    rerun_check(copy)
    return at - about.end


@pytest.mark.parametrize('parameters', [(), ('record_rate:=10000', 'fsync:=true')])
def test_a_killed_twin_leaves_a_readable_recording(start_twin, parameters):
    assert killed(start_twin, 0.7, *parameters) <= MOST_LOST


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_fifty_killed_twins(start_twin):
    draw = random.Random(5)
    losses = [killed(start_twin, draw.uniform(0.0, 1.5)) for _ in range(50)]
    print(f'50 twins killed: the largest loss {max(losses) * 1e-6:.0f} ms, the median '
          f'{sorted(losses)[25] * 1e-6:.0f} ms')
    assert max(losses) <= MOST_LOST
