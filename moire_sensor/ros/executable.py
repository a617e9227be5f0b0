"""How each executable of this package starts, and ends: 0 on SIGINT and SIGTERM, one line and 1 on an error."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from moire_sensor.errors import MoireError, SettingsError
from moire_sensor.idle_threads import let_idle_threads_sleep
from moire_sensor.resources import resource_path

PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Parameters of glibc's mallopt, and what they are set to: memory from the kernel only for what is larger than any
# message, and given back only beyond what a few results need.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
KEPT_BYTES, LARGEST_BYTES = 256 * 1024 * 1024, 32 * 1024 * 1024
# The middleware waits in C, where a Python signal handler cannot run: look up this often.
WAKE_UP_S = 0.1
RCLError = rclpy_implementation.RCLError
# What a user can cause with --ros-args; rclpy has no common class for them.
USER_ERRORS = (MoireError, ParameterException, NameValidationException, InvalidQosOverridesError)


def use_large_message_profile() -> None:
    """Point Fast DDS to the profile of this package unless the user chose one; call it before ``rclpy.init``."""
    if not any(os.environ.get(name) for name in PROFILE_VARIABLES):
        os.environ[PROFILE_VARIABLES[0]] = str(resource_path("config/fastdds.xml"))


def keep_freed_memory() -> None:
    """Let the C library keep the megabytes that a message or an image leaves behind, for the next one.

    By default it gives them back to the kernel, which hands them out again page by page: a fifth of the time of a
    result with all its messages. Other C libraries than glibc are left as they are.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_THRESHOLD, LARGEST_BYTES)
        mallopt(M_TRIM_THRESHOLD, KEPT_BYTES)


def run_node(make_node: Callable[[], Any], usage: str) -> int:
    """Make a node, spin it until a signal comes or its work is done, and return the exit code."""
    return run_nodes((make_node,), usage)


def run_nodes(makers: Sequence[Callable[[], Any]], usage: str) -> int:
    """Make nodes, spin them in one executor until a signal comes or the work of one is done; return the exit code.

    ``usage`` is printed for --help. A node may have ``finished()``, asked after each callback, and ``close()``, called
    at the end, the last made first; where it has ``stop_asked``, that is set to a function that tells of a signal. An
    error that a user can cause is printed as one line and gives 1.
    """
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(usage.strip())
        return 0
    let_idle_threads_sleep()
    keep_freed_memory()
    stop = _Stop()
    nodes: list[Any] = []
    code = 0
    try:
        initialise(sys.argv)
        _make(makers, nodes, stop)
        stop.raises = False
        _spin(nodes, stop)
    except KeyboardInterrupt:
        pass
    except USER_ERRORS as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        code = 1
    except RCLError as error:
        # The middleware refuses, for example where security is asked for and there is no key.
        print(f"error: the middleware refuses: {' '.join(str(error).split())}", file=sys.stderr)
        code = 1
    except Exception:
        # The signal's exception may have struck inside a library that turned it into its own.
        if not (stop.asked and len(nodes) < len(makers)):
            # Not raised again: the interpreter cannot end in peace while a thread still compiles.
            traceback.print_exc()
            code = 1
    finally:
        stop.raises = False
        _close(nodes)
        rclpy.try_shutdown()
    return _leave(code)


def initialise(arguments: list[str]) -> None:
    """Initialise rclpy with this package's DDS profile; raises SettingsError for arguments it does not know."""
    use_large_message_profile()
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise SettingsError(f"bad --ros-args {' '.join(arguments[1:])!r}: {error}") from error
    unknown = remove_ros_args(arguments)[1:]
    if unknown:
        raise SettingsError(
            f"unknown argument {' '.join(unknown)!r}; give parameters as --ros-args -p name:=value, or --help"
        )


def _leave(code: int) -> int:
    """Return the exit code; leave at once while a thread still compiles, which the interpreter cannot end in peace.

    A signal that comes now has nothing left to end. The interpreter drops its own handlers on the way out, and the
    process would end by the signal in place of the exit code; an ignored one stays ignored.
    """
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if threading.active_count() > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


class _Stop:
    """Both signals: during the start they end what is under way, later they end the spinning."""

    def __init__(self) -> None:
        self.asked = False
        self.raises = True
        for number in SIGNALS:
            signal.signal(number, self)

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        if self.raises:
            raise KeyboardInterrupt


def _make(makers: Sequence[Callable[[], Any]], nodes: list[Any], stop: _Stop) -> None:
    """Make nodes one by one; ``nodes`` holds the first ones also when a later one fails."""
    for make_node in makers:
        node = make_node()
        nodes.append(node)
        if hasattr(node, "stop_asked"):
            node.stop_asked = lambda: stop.asked


def _close(nodes: Sequence[Any]) -> None:
    for node in reversed(nodes):
        getattr(node, "close", bool)()
        node.destroy_node()


def _spin(nodes: Sequence[Any], stop: _Stop) -> None:
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    tellers = [node.finished for node in nodes if hasattr(node, "finished")]
    while not (stop.asked or any(finished() for finished in tellers)):
        executor.spin_once(timeout_sec=WAKE_UP_S)
    for node in nodes:
        executor.remove_node(node)
