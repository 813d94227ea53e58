"""An arm made of literal numbers, which shares neither property tables nor packing with the driver.

Its property numbers are the reference's rows written out by generation, its replies are packed here byte by byte (WAM
reference 2.1 to 2.5, 3.1, 4.7). It keeps every frame that a host sent, with its time, and fails any test in which the
host tried to raise the arm's mode.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest

from drivers.clock import VirtualClock
from drivers.simulated.can_hub import MemoryCanBus, MemoryCanHub
from drivers.simulated.can_wire import Frame, TimedFrame

FIRST = {"VERS": 0, "ROLE": 1, "STAT": 5}
_FROM_61 = {**FIRST, "MODE": 8, "P": 48, "T": 42, "MT": 43, "GRPA": 26, "GRPB": 27, "GRPC": 28}
_BELOW_61 = {**FIRST, "MODE": 8, "P": 26, "MT": 16, "GRPA": 51, "GRPB": 52, "GRPC": 53, "CTS": 30, "MECH": 28}
MOTOR_NUMBERS = {
    200: {**_FROM_61, "CTS": 68, "IPNM": 86, "PIDX": 70, "POLES": 90, "MECH": 66},
    141: {**_FROM_61, "CTS": 68, "IPNM": 86, "PIDX": 70, "POLES": 90, "MECH": 66},
    118: {**_FROM_61, "CTS": 68, "IPNM": 86, "PIDX": 70, "POLES": 90, "MECH": 66},
    63: {**_FROM_61, "CTS": 65, "IPNM": 83, "PIDX": 67, "POLES": 87, "MECH": 63},
    60: {**_BELOW_61, "T": 9, "IPNM": 108, "PIDX": 54, "POLES": 112},
    32: {**_BELOW_61, "T": 10, "PIDX": 54},
}
_SAFETY_FROM_61 = {**FIRST, "MODE": 8, "GRPA": 26, "GRPB": 27, "GRPC": 28, "SAVE": 30, "LOAD": 31, "DEF": 32}
_SAFETY_FROM_61 |= {"ZERO": 42, "PEN": 43, "VL1": 45, "VL2": 46, "TL1": 47, "TL2": 48, "IFAULT": 55}
_SAFETY_BELOW_61 = {**FIRST, "MODE": 8, "GRPA": 51, "GRPB": 52, "GRPC": 53, "SAVE": 87, "LOAD": 88, "DEF": 89}
_SAFETY_BELOW_61 |= {"ZERO": 55, "PEN": 85, "VL1": 90, "VL2": 91, "TL1": 92, "TL2": 93, "IFAULT": 100}
SAFETY_NUMBERS = {197: _SAFETY_FROM_61, 141: _SAFETY_FROM_61, 118: _SAFETY_FROM_61, 60: _SAFETY_BELOW_61}
SAFETY_NUMBERS[32] = _SAFETY_BELOW_61
FACTORY_LIMITS = {"VL1": 2048, "VL2": 4096, "TL1": 4731, "TL2": 5204}

HOME_COUNTS = (0, -36833, 36832, -36728, 0, 0, 0)
"""Reference 5.2: home in counts of 4096 a turn."""
ANSWER_NS = 20_000
SECOND_NS = 1_000_000_000


@dataclass
class ScriptedPuck:
    """Properties by name, and how the puck behaves."""

    numbers: dict[str, int]
    values: dict[str, int]
    asleep: bool = False
    silent_until_ns: int = 0
    wakes_in_ns: int = SECOND_NS
    refuses: set[str] = field(default_factory=set)
    """Properties whose SET it ignores."""

    def name(self, number: int) -> str:
        known = FIRST if self.asleep else self.numbers
        return next((name for name, own in known.items() if own == number), "")

    def read(self, name: str) -> int:
        if name == "STAT" and self.asleep:
            return 0
        return 12 if name == "VERS" and self.asleep else self.values[name]


class ScriptedArm:
    """Nodes 1 to 7 and 10, awake, idle and zeroed at home; a device of a MemoryCanHub."""

    def __init__(self, motor_firmware: int = 200, safety_firmware: int = 197) -> None:
        self.clock = VirtualClock()
        self.bus = MemoryCanBus(MemoryCanHub([self]), self.clock)
        self.heard: list[tuple[int, int, bytes]] = []
        """Time, identifier and data of every frame that the host sent."""
        self.loses: Callable[[int], bool] = lambda _: False
        """Whether the frame of this number, from 0, gets lost on its way."""
        self.events: list[tuple[int, Callable[[], None]]] = []
        """What happens by itself, and when."""
        self.pucks: dict[int, ScriptedPuck] = {}
        for node in range(1, 8):
            self.pucks[node] = ScriptedPuck(MOTOR_NUMBERS[motor_firmware], _motor_values(node, motor_firmware))
        values = {"VERS": safety_firmware, "ROLE": 0x0082, "STAT": 2, "MODE": 1, "GRPA": 1, "GRPB": 2, "GRPC": 3}
        values |= {"ZERO": 1, "PEN": 0x0D3F1249, "IFAULT": 0, **FACTORY_LIMITS}
        self.pucks[10] = ScriptedPuck(SAFETY_NUMBERS[safety_firmware], values)

    @property
    def safety(self) -> dict[str, int]:
        """Properties of the safety puck."""
        return self.pucks[10].values

    def sleep(self, *nodes: int) -> None:
        """Reset pucks into their boot monitor: their positions are gone."""
        for node in nodes:
            self.pucks[node].asleep = True
            self.pucks[node].values["P"] = 111 * node

    def at(self, time_s: float, event: Callable[[], None]) -> None:
        """Let something happen by itself."""
        self.events.append((round(time_s * SECOND_NS), event))
        self.events.sort(key=lambda entry: entry[0])

    def written(self) -> list[str]:
        """Every SET that was heard, as identifier#data in hexadecimal."""
        return [f"{identifier:03X}#{data.hex().upper()}" for _, identifier, data in self.heard if data[0] & 0x80]

    def receive(self, frame: Frame, now_ns: int) -> list[TimedFrame]:
        while self.events and self.events[0][0] <= now_ns:
            self.events.pop(0)[1]()
        identifier, data = frame
        if identifier & 0x3E0:
            return []  # a puck's, perhaps its own
        self.heard.append((now_ns, identifier, data))
        if self.loses(len(self.heard) - 1):
            return []
        frames = []
        for node, puck in self.pucks.items():
            groups = [puck.values.get(name) for name in ("GRPA", "GRPB", "GRPC")]
            to_it = (identifier & 0x1F) in groups and not puck.asleep if identifier & 0x400 else identifier == node
            if not to_it or now_ns < puck.silent_until_ns or len(data) == 8:
                continue
            name = puck.name(data[0] & 0x7F)
            if data[0] & 0x80:
                self._set(puck, name, int.from_bytes(data[2:], "little", signed=True), now_ns)
            elif name == "P":
                counts = (puck.values["P"] & 0x3FFFFF).to_bytes(3, "big")
                frames.append((now_ns + ANSWER_NS, Frame(0x403 | node << 5, counts)))
            elif name:
                value = puck.read(name)
                width = 4 if name in ("CTS", "MECH", "PEN") else 2
                payload = bytes((0x80 | data[0], 0)) + value.to_bytes(4, "little", signed=True)[:width]
                frames.append((now_ns + ANSWER_NS, Frame(0x406 | node << 5, payload)))
        return frames

    def tick(self, now_ns: int) -> list[TimedFrame]:
        return []

    def _set(self, puck: ScriptedPuck, name: str, value: int, now_ns: int) -> None:
        if not name or name in puck.refuses:
            return
        if name == "STAT" and value == 2 and puck.asleep:
            puck.asleep, puck.silent_until_ns = False, now_ns + puck.wakes_in_ns
        elif name == "LOAD":
            limit = next(limit for limit, number in puck.numbers.items() if number == value)
            puck.values[limit] = FACTORY_LIMITS[limit]
        elif name != "DEF":
            puck.values[name] = value


def _motor_values(node: int, firmware: int) -> dict[str, int]:
    lower = node <= 4
    return {
        "VERS": firmware,
        "ROLE": 0x01C0,
        "STAT": 2,
        "MODE": 0,
        "P": HOME_COUNTS[node - 1],
        "MT": (4860, 4860, 4860, 4320, 3900, 3900, 1600)[node - 1],
        "CTS": 4096,
        "MECH": HOME_COUNTS[node - 1] % 4096,
        "IPNM": (2700, 2700, 2700, 2700, 6500, 6500, 17474)[node - 1],
        "PIDX": node if lower else node - 4,
        "POLES": (12, 12, 12, 12, 8, 8, 6)[node - 1],
        "GRPA": 0,
        "GRPB": 1 if lower else 2,
        "GRPC": 4,
    }


def _raises_mode(identifier: int, data: bytes) -> bool:
    """SET MODE of a motor puck to anything but idle, or of the safety puck to active: the operator's business."""
    if len(data) not in (4, 6) or data[0] != 0x88:
        return False
    value = int.from_bytes(data[2:], "little")
    return value > 1 if identifier == 0x00A else value > 0


@pytest.fixture
def make_arm() -> Iterator[Callable[..., ScriptedArm]]:
    """Makes scripted arms: `make_arm(motor_firmware=200, safety_firmware=197)`."""
    made: list[ScriptedArm] = []

    def make(motor_firmware: int = 200, safety_firmware: int = 197) -> ScriptedArm:
        made.append(ScriptedArm(motor_firmware, safety_firmware))
        return made[-1]

    yield make
    for arm in made:
        assert not any(_raises_mode(identifier, data) for _, identifier, data in arm.heard)
