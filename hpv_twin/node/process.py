"""
A node of this package as a process: signals, threads, an orderly end.

Three threads: the main one waits for signals and keeps the terminal's status line; the pacing
thread runs the model and publishes; the executor's thread serves setpoints, services and
parameters.
"""
from __future__ import annotations

import os
import signal
import sys
import threading
import time

# The pacing thread waits this long at most for the interpreter's lock.
SWITCH_INTERVAL = 0.5e-3
# Between two spins of the executor: a flood of messages cannot starve the pacing thread.
BETWEEN_SPINS = 1e-3
IMPATIENCE = 3  # signals after which the process ends without ceremony


class StopSignal:
    """SIGINT and SIGTERM, however many: a wish to end, not an exception in the middle of it."""

    def __init__(self):
        self._wished = threading.Event()
        self._count = 0

    def catch(self) -> None:
        """Take over the signals. From the main thread."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, number, _frame):
        self._count += 1
        self._wished.set()
        if self._count >= IMPATIENCE + 1:
            os._exit(128 + number)

    def ignore(self) -> None:
        """Be deaf to signals: the interpreter, as it ends, would let one more of them kill it."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)

    def wish(self) -> None:
        """Ask for the end from inside."""
        self._wished.set()

    def is_set(self) -> bool:
        """Whether the process was asked to end."""
        return self._wished.is_set()

    def wait(self, seconds: float) -> bool:
        """Wait; True as soon as the process is asked to end."""
        return self._wished.wait(seconds)


def run_node(name: str, argv: list[str], load) -> int:
    """
    Run a node until a signal; 0 after an orderly end, 1 on failure, 2 for bad parameters.

    `load()` imports what it takes and returns the node's class and its console.
    """
    stop = StopSignal()
    stop.catch()
    code = run(name, argv, load, stop)
    stop.ignore()
    return code


def run(name, argv, load, stop) -> int:
    """Start ROS, build the node, serve it until the end."""
    import rclpy
    from rclpy._rclpy_pybind11 import RCLError  # has no public name
    from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
    from rclpy.signals import SignalHandlerOptions

    from hpv_twin.model import VibratorError

    from .params_files import ParameterError, origins

    node_class, console = load()
    try:
        files = origins(argv)
        rclpy.init(args=[name, *argv], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        print(f'hpv-twin {name}: {one_line(error)}', file=sys.stderr)
        return 2
    try:
        node = node_class(files)
    except (ParameterError, VibratorError, InvalidParameterTypeException,
            InvalidParameterValueException, RCLError) as error:
        print(f'hpv-twin {name}: {one_line(error)}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    try:
        return serve(node, stop, console)
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()


def one_line(error) -> str:
    """An exception's text without its line breaks."""
    return ' '.join(str(error).split())


def serve(node, stop, console) -> int:
    """Run the loop and the executor until a signal or a failure."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    node.before_speaking = console.clear
    if not warm_up(node, stop):
        return 0
    executor_thread = threading.Thread(target=spin, args=(node, stop), name='executor')
    node.start()
    executor_thread.start()
    console.banner(node)
    while not stop.wait(1.0) and node.loop.failure is None:
        console.status(node)
    console.clear()
    stop.wish()
    executor_thread.join(timeout=1.0)
    if node.loop.failure is not None:
        node.say('error', f'the pacing thread has died: {node.loop.failure!r}')
        node.last_words()
        return 1
    return 0


def warm_up(node, stop) -> bool:
    """Compile in a thread of its own, which nobody waits for once the process is to end."""
    compiling = threading.Thread(target=node.warm_up, name='compiler', daemon=True)
    compiling.start()
    while compiling.is_alive():
        compiling.join(0.05)
        if stop.is_set() and compiling.is_alive():
            node.close()
            node.destroy_node()
            sys.stdout.flush()
            # The compiler cannot be interrupted, nor can the interpreter end beneath it.
            os._exit(0)
    return not stop.is_set()


def spin(node, stop) -> None:
    """Serve callbacks one at a time with a pause after each; one that fails is not the last."""
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        try:
            executor.spin_once(timeout_sec=0.1)
        except Exception as error:
            node.inputs.failed(error)
        time.sleep(BETWEEN_SPINS)
    executor.shutdown(timeout_sec=0.5)
