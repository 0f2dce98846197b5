"""
Write the golden files anew: only when the format is meant to change.

    python test/recording/make_golden.py
"""
import shutil
import tempfile
from pathlib import Path

import recording_tools as tools

HERE = Path(__file__).parent / 'golden'
FLOW_VALUE, TICKS = 7.3e-4, 40


def main():
    """Record a bare file; split the same messages into two parts of a folder."""
    opening = [(tools.FLOW, tools.START, tools.scalar(FLOW_VALUE))]
    last = tools.START + (TICKS - 1) * tools.MILLISECOND
    messages = [*tools.ticks(TICKS), (tools.DIAGNOSTICS, last, tools.diagnostics(last))]
    explained = {'metadata': {'package_version': '0.1.0', 'ambient_pressure': '101325.0'},
                 'attachments': {'vibrator.yaml': b'stroke: 0.002\n'}}
    with tempfile.TemporaryDirectory() as work:
        path = tools.record(work, messages, opening, **explained)
        shutil.copy(path, HERE / 'bare.mcap')
    with tempfile.TemporaryDirectory() as work:
        recording = tools.recorder(work, **explained)
        recording.start(opening)
        series = recording._session.series
        for k, message in enumerate(messages):
            if k == TICKS:  # half of them; the recorder sees it before the next message
                tools.wait_until(lambda: not recording._session.queue)
                series._next_file_because = 'its time was over'
            recording.write(*message)
        folder = recording.stop()
        shutil.rmtree(HERE / 'split', ignore_errors=True)
        shutil.copytree(folder, HERE / 'split')


if __name__ == '__main__':
    main()
