"""Start the executables of this package as processes, and stop them cleanly."""

from __future__ import annotations

import signal
import subprocess
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# A clean end takes a second; this bounds a hang.
END_TIMEOUT_S = 20.0


@dataclass
class NodeProcess:
    """A running executable; what it prints goes to a log file."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    @classmethod
    def start(cls, name: str, parameters: Sequence[str], log: Path) -> NodeProcess:
        """Start an executable with parameters such as ``"rate_hz:=10.0"``."""
        return cls.run([str(Path(sysconfig.get_path("scripts")) / name)], parameters, log)

    @classmethod
    def run(cls, command: Sequence[str], parameters: Sequence[str], log: Path) -> NodeProcess:
        """Start any command that takes parameters as the executables do; the last word is its name."""
        arguments = ["--ros-args", *(part for parameter in parameters for part in ("-p", parameter))]
        with log.open("wb") as output:
            process = subprocess.Popen(
                [*command, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
            )
        return cls(Path(command[-1]).name, process, log)

    def ended_badly(self) -> bool:
        """Tell whether it has ended with an exit code other than 0."""
        return self.process.poll() not in (None, 0)

    def stop(self) -> int:
        """Interrupt it as Ctrl-C does and return its exit code; it is killed if it does not end."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(timeout=END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def last_words(self) -> str:
        """Return the last line of its log."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it printed nothing"
