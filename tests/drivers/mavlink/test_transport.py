"""Where a link goes is read as written, and anything else is refused with what is allowed."""

import pytest

from drivers.errors import LinkError
from drivers.mavlink.transport import LinkAddress


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpin:0.0.0.0:14550", LinkAddress("udpin", "0.0.0.0", 14550)),
        ("udpout:companion.local:14550", LinkAddress("udpout", "companion.local", 14550)),
        (" tcp:127.0.0.1:5760 ", LinkAddress("tcp", "127.0.0.1", 5760)),
        ("tcp:[::1]:5760", LinkAddress("tcp", "::1", 5760)),
        ("serial:/dev/ttyUSB0:57600", LinkAddress("serial", "/dev/ttyUSB0", 57600)),
        (
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0:115200",
            LinkAddress("serial", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0", 115200),
        ),
    ],
)
def test_an_address_is_read_as_written(text, address):
    assert LinkAddress.parse(text) == address


@pytest.mark.parametrize("text", ["udpin:127.0.0.1:14550", "tcp:[::1]:5760", "serial:/dev/ttyUSB0:57600"])
def test_an_address_is_written_as_it_is_read(text):
    assert str(LinkAddress.parse(text)) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "14550",
        "udpin:14550",
        "udp:127.0.0.1:14550",
        "UDPIN:127.0.0.1:14550",
        "udpin:127.0.0.1:65536",
        "udpin:127.0.0.1:-1",
        "udpin:127.0.0.1:",
        "udpin::14550",
        "udpin:12 7:1",
        "tcp:a:b:1",
        "/dev/ttyACM0",
        "udpin:127.0.0.1:14550:57600",
        "serial:/dev/ttyUSB0",
        "serial:/dev/ttyUSB0:",
        "serial::57600",
        "serial:/dev/ttyUSB0:00",
        "serial:/dev/my radio:57600",
        "serial:/dev/ttyUSB0:57600baud",
    ],
)
def test_anything_else_is_refused_with_what_is_allowed(text):
    with pytest.raises(LinkError, match=r"is not SCHEME:HOST:PORT with .* udpin, udpout, tcp, nor serial:") as caught:
        LinkAddress.parse(text)
    assert repr(text) in str(caught.value)
