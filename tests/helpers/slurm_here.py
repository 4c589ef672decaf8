"""A Slurm cluster of this machine alone: one controller and two nodes on the loopback interface."""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAMS = ("slurmctld", "slurmd", "munged", "sbatch", "scontrol")

NODES = ("node1", "node2")

START_S = 60

CONF = """
ClusterName=mcstudy
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
KillWait=2
SlurmdParameters=config_overrides
NodeName=node1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=2 RealMemory=4000
NodeName=node2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=2 RealMemory=4000
PartitionName=all Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str | None:
    """What is missing to start a Slurm cluster here; None when all is there."""
    if os.geteuid() != 0:
        return "Slurm's daemons need root"
    absent = [name for name in PROGRAMS if shutil.which(name) is None]
    return f"{', '.join(absent)} not installed (Debian: slurm-wlm, munge)" if absent else None


class Slurm:
    """A running cluster; ``environment`` is what its commands need."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
        (folder / "slurm.conf").write_text(
            CONF.format(host=socket.gethostname().split(".")[0], folder=folder, ports=_free_ports(3))
        )
        for name in ("state", *(f"spool-{n}" for n in NODES)):
            (folder / name).mkdir()
        self._daemons: dict[str, subprocess.Popen[bytes]] = {}
        key = folder / "munge.key"
        key.write_bytes(secrets.token_bytes(1024))
        key.chmod(0o400)
        self._start(
            "munged", "--foreground", "--force", f"--key-file={key}", f"--socket={folder}/munge.sock",
            f"--pid-file={folder}/munge.pid", f"--log-file={folder}/munge.log", f"--seed-file={folder}/munge.seed",
        )  # fmt: skip
        self._until(lambda: (folder / "munge.sock").exists())
        self.start_controller()
        for node in NODES:
            self._start("slurmd", "-D", "-N", node)
        self._until(lambda: self.ask("sinfo", "-h", "-o", "%T").split() == ["idle"])

    def _start(self, *words: str) -> None:
        self._daemons[" ".join(words)] = subprocess.Popen(
            words, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def _until(self, ready: object) -> None:
        end = time.monotonic() + START_S
        while not ready():  # type: ignore[operator]
            assert time.monotonic() < end, self.said()
            time.sleep(0.1)

    def start_controller(self) -> None:
        """Start slurmctld, with the state it had."""
        self._start("slurmctld", "-D")
        self._until(lambda: "UP" in self.ask("scontrol", "ping"))

    def kill_controller(self) -> None:
        """End slurmctld without warning."""
        daemon = self._daemons.pop("slurmctld -D")
        daemon.kill()
        daemon.wait()

    def ask(self, *words: str) -> str:
        """What one of Slurm's commands prints."""
        return subprocess.run(
            words, env=self.environment, capture_output=True, text=True, timeout=60, check=False
        ).stdout

    def running(self) -> set[int]:
        """Numbers of the jobs that run."""
        return {int(number) for number in self.ask("squeue", "-h", "-t", "R", "-o", "%A").split()}

    def jobs(self) -> set[int]:
        """Numbers of all jobs that wait, run or are ending."""
        return {int(number) for number in self.ask("squeue", "-h", "-o", "%A").split()}

    def said(self) -> str:
        """The end of the daemons' logs."""
        return "\n".join(file.read_text(errors="replace")[-2000:] for file in self.folder.glob("*.log"))

    def close(self) -> None:
        """End all jobs and daemons."""
        self.ask("scancel", "--user=root")
        for daemon in reversed(self._daemons.values()):
            daemon.terminate()
        for daemon in self._daemons.values():
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def _free_ports(number: int) -> list[int]:
    sockets = [socket.socket() for _ in range(number)]
    try:
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


@contextmanager
def slurm(folder: Path) -> Iterator[Slurm]:
    """A `Slurm` cluster that is ended at the end; ``folder``: an empty folder with a short path."""
    made = Slurm(folder)
    try:
        yield made
    finally:
        made.close()
