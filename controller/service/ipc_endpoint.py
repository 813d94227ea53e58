"""Binding a ZeroMQ socket to an ipc path that belongs to this daemon alone.

libzmq removes whatever file it finds at the path and takes its place without a word. So it is checked first that
nobody answers there and that what lies there is a dead socket; the new one is for owner and group only.
"""

from __future__ import annotations

import os
import socket
import stat
from pathlib import Path

import zmq

from drivers.errors import ConfigurationError

_LONGEST_PATH = 107  # sockaddr_un.sun_path less its final zero
_MODE = 0o660  # owner and group: who may open the path may command the robot


def bind_ipc(zmq_socket: zmq.Socket[bytes], key: str, endpoint: str) -> Path:
    """Bind to `endpoint` (ipc:// and an absolute path) with file mode 0660; returns the path.

    The directory is made if need be (mode 0750). Raises ConfigurationError under the configuration key `key` if the
    path is not usable or another process serves it.
    """
    path = Path(endpoint.removeprefix("ipc://"))
    if not endpoint.startswith("ipc:///") or len(os.fsencode(path)) > _LONGEST_PATH:
        raise _refusal(key, endpoint, f"ipc:// and an absolute path of at most {_LONGEST_PATH} bytes")
    try:
        path.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
        owner = path.parent.stat().st_uid
        if os.getuid() not in (0, owner) and owner != 0:
            raise _refusal(key, endpoint, f"a directory of this user's; {path.parent} belongs to user {owner}")
        _refuse_occupied(path, key, endpoint)
        before = os.umask(0o777 & ~_MODE)
        try:
            zmq_socket.bind(endpoint)
        finally:
            os.umask(before)
        path.chmod(_MODE)
    except (OSError, zmq.ZMQError) as error:
        raise _refusal(key, endpoint, f"a path where a socket can be made ({error.strerror})") from error
    return path


def _refuse_occupied(path: Path, key: str, endpoint: str) -> None:
    if not path.exists():
        return
    if not stat.S_ISSOCK(path.stat().st_mode):
        raise _refusal(key, endpoint, "a path where no other file lies")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return  # left behind by a daemon that was killed
        except BlockingIOError:
            pass  # somebody listens, and is busy
    raise _refusal(key, endpoint, "a path that no other daemon serves; one is running there already")


def _refusal(key: str, endpoint: str, accepted: str) -> ConfigurationError:
    return ConfigurationError("[front]", key, endpoint, accepted)
