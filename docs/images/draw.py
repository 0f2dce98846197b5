"""
Draw the pictures of the README anew, without a screen: `make pictures`.

    replay.png    the whole scene of bags/example.mcap
    cutaway.png   the machine at four phases of one cycle
    overview.png  the whole run

Needs a Vulkan driver; on Debian and Ubuntu mesa-vulkan-drivers and libvulkan1 will do.
"""
import os
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont
from rerun.experimental import ViewerClient

from hpv_twin.viewer import replay, viewer_process

HERE = Path(__file__).parent
RECORDING = HERE.parents[1] / 'bags' / 'example.mcap'
SOFTWARE = sorted(Path('/usr/share/vulkan/icd.d').glob('lvp_icd*.json'))
CUTAWAY = (0, 65, 760, 490)  # of a picture 1920 x 1080: left, top, right, bottom
OVERVIEW = (762, 657, 1524, 1050)
# Seconds since the start of the recording, within one cycle.
PHASES = {'build-up, t_kh': 5.0600, 'forward, t_kn': 5.0800, 'dwell, t_kb': 5.0815,
          'return, t_RS': 5.0822}
WHOLE = 5.0800


def main():
    """Draw all pictures."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / 'example.rrd'
        if replay.main([str(RECORDING), '--save', str(scene)]):
            return 1
        shots = draw(scene, [WHOLE, *PHASES.values()])
    shots[0].save(HERE / 'replay.png', optimize=True)
    shots[0].crop(OVERVIEW).save(HERE / 'overview.png', optimize=True)
    side_by_side(shots[1:]).save(HERE / 'cutaway.png', optimize=True)
    return 0


def draw(scene, times):
    """Return the scene with its cursor at each of `times` (s)."""
    port = viewer_process.free_port()
    if SOFTWARE:
        os.environ.setdefault('VK_ICD_FILENAMES', str(SOFTWARE[0]))
    os.environ.setdefault('XDG_RUNTIME_DIR', str(scene.parent))
    shots = []
    with viewer_process.running('--headless', '--window-size', '1920x1080', '--port', str(port),
                                str(scene)) as child:
        viewer_process.wait_for(port, child)
        client = ViewerClient.connect(f'rerun+http://{viewer_process.HOST}:{port}/proxy')
        time.sleep(3.0)  # the scene is loaded
        for at in times:
            client.set_time('time', duration=at, play_state='paused')
            time.sleep(2.0)  # the axes settle
            file = scene.with_name(f'{at}.png')
            client.save_screenshot(str(file))
            shots.append(Image.open(file).convert('RGB'))
        child.terminate()
        child.wait()
        child.returncode = 0  # it was asked to end
    return shots


def side_by_side(shots):
    """Return the cutaways of the four phases, two in a row, each with its name."""
    width, height = CUTAWAY[2] - CUTAWAY[0], CUTAWAY[3] - CUTAWAY[1]
    sheet = Image.new('RGB', (2 * width, 2 * height))
    font = ImageFont.load_default(20)
    for index, (name, shot) in enumerate(zip(PHASES, shots, strict=True)):
        corner = index % 2 * width, index // 2 * height
        sheet.paste(shot.crop(CUTAWAY), corner)
        ImageDraw.Draw(sheet).text((corner[0] + width - 16, corner[1] + 10), name,
                                   fill=(206, 212, 218), font=font, anchor='rt')
    return sheet


if __name__ == '__main__':
    if not (os.environ.get('VK_ICD_FILENAMES') or SOFTWARE):
        sys.exit('docs/images/draw.py: no Vulkan driver in /usr/share/vulkan/icd.d; on Debian and '
                 'Ubuntu: apt install mesa-vulkan-drivers libvulkan1')
    sys.exit(main())
