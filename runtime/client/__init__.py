"""Plans and streams from a server, without a network of one's own.

from runtime.client import Client
with Client("http://127.0.0.1:8000") as client:
    plan = client.plan(position)  # (K, 2) metres at 1 kHz
"""

from runtime.client.client import Client
from runtime.client.stream import RemoteStream

__all__ = ["Client", "RemoteStream"]
