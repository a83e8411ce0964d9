"""Serial ports that look like boards, and the URLs that open each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ergon import _core

SERIAL_LINKS_FOLDER = Path("/dev/serial/by-id")
# USB vendor → name of the board or chip, and the kinds of device that are built with it.
_VENDORS: dict[int, tuple[str, tuple[str, ...]]] = {
    0x2341: ("Arduino", ("firefader", "frame")),
    0x2A03: ("Arduino", ("firefader", "frame")),
    0x0403: ("FTDI", ("firefader",)),
    0x1A86: ("CH340", ("firefader",)),
    0x16C0: ("Teensy", ("frame",)),
    0x2E8A: ("RP2040", ("frame",)),
}


@dataclass(frozen=True, slots=True)
class Port:
    """A serial port. `urls` open the boards that it may be; none where no board is recognised."""

    path: str
    name: str
    urls: tuple[str, ...]


def ports() -> list[Port]:
    """All serial ports; opens none."""
    return [_describe_port(port.path, port.usb) for port in _core.serial_ports()]


def _describe_port(path: str, usb: _core.UsbBoard | None) -> Port:
    if usb is None:
        return Port(path, "", ())
    vendor_name, kinds = _VENDORS.get(usb.vendor, ("", ()))
    name_parts = [vendor_name] if vendor_name and vendor_name not in usb.name else []
    name_parts += [word for word in (usb.name, usb.serial) if word]
    stable_path = _stable_path(path)
    return Port(path, " ".join(name_parts), tuple(f"{kind}:{stable_path}" for kind in kinds))


def _stable_path(path: str) -> str:
    """A path that does not depend on the order in which boards are plugged in."""
    try:
        device_links = sorted(SERIAL_LINKS_FOLDER.iterdir())
    except OSError:
        return path
    matching_links = (str(link) for link in device_links if link.resolve() == Path(path).resolve())
    return next(matching_links, path)


def latency_timer(url: str, root: Path = Path("/sys/bus/usb-serial/devices")) -> int | None:
    """How long an FTDI chip holds bytes back [ms]; None where the port is of another kind."""
    target = url.partition(":")[2].partition("?")[0]
    name = Path(target).resolve().name
    try:
        return int((root / name / "latency_timer").read_text())
    except (OSError, ValueError):
        return None
