"""Why a router cannot be reached, in one sentence: Zenoh tells only that it is so."""

from __future__ import annotations

import re
import socket
import ssl

from swarm.traffic import TrafficClass
from swarm.trust.identity import Identity

CONNECT_S = 2.0
ALERT_S = 0.5
"""In TLS 1.3 a server refuses a client's certificate only after the client's side is done."""
_LOCATOR = re.compile(r"(?P<protocol>tcp|tls)/(?P<host>\[[^\]]+\]|[^:/\s]+):(?P<port>\d+)")
_OTHER_NAME = (62, 64)
"""OpenSSL's X509_V_ERR_HOSTNAME_MISMATCH and X509_V_ERR_IP_ADDRESS_MISMATCH."""


def why_not(locator: str, identity: Identity | None) -> str:
    """What keeps a client from a router at `tcp/HOST:PORT` or `tls/HOST:PORT`, found out by a
    connection of its own; empty where nothing does, or the locator has another form.

    Takes CONNECT_S and some at most, and longer only where a name server does not answer.
    """
    found = _LOCATOR.match(locator)
    if found is None:
        return ""
    host, port = found["host"].strip("[]"), int(found["port"])
    try:
        connection = _connected(host, port)
    except socket.gaierror as error:
        return f"{host!r} is the name of no machine ({error.strerror}): a typo?"
    except ConnectionRefusedError:
        return f"{host} is there, but nothing listens on its port {port}"
    except TimeoutError:
        return f"{host} does not answer: a typo, a firewall, or its network is cut"
    except OSError as error:
        return f"{host} cannot be reached: {error.strerror or error}"
    with connection:
        return _refused(connection, host, identity) if found["protocol"] == "tls" else ""


def _connected(host: str, port: int) -> socket.socket:
    """A connection to the first of a host's addresses that takes one. Raises OSError."""
    failed: OSError | None = None
    for family, kind, protocol, _, address in socket.getaddrinfo(
        host, port, type=socket.SOCK_STREAM
    ):
        connection = socket.socket(family, kind, protocol)
        try:
            _mark(connection)
            connection.settimeout(CONNECT_S)
            connection.connect(address)
        except OSError as error:
            connection.close()
            failed = error
        else:
            return connection
    raise failed or OSError(f"{host} has no address")


def _mark(connection: socket.socket) -> None:
    """As the control traffic that it is: what carries no mark waits behind all that does."""
    if connection.family == socket.AF_INET6:
        connection.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_TCLASS, TrafficClass.CONTROL.tos)
    else:
        connection.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, TrafficClass.CONTROL.tos)


def _refused(connection: socket.socket, host: str, identity: Identity | None) -> str:
    """Why TLS fails on a connection; empty where it does not."""
    if identity is None:
        return ""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_verify_locations(identity.ca)
        context.load_cert_chain(identity.certificate, identity.key)
    except OSError:
        return ""  # Who shows it finds out by itself what is wrong with it.
    try:
        secured = context.wrap_socket(connection, server_hostname=host)
    except ssl.SSLCertVerificationError as error:
        if error.verify_code in _OTHER_NAME:
            return (
                f"the router's certificate is not for {host}: "
                f"`coadapt certs issue router --address {host}` where the router runs"
            )
        return (
            f"the router's certificate is not of the authority in {identity.ca} "
            f"({error.verify_message}): another swarm's router, or another swarm's certificate"
        )
    except OSError:
        return f"{host} does not speak TLS there: a plain swarm's router is tcp/HOST:PORT"
    with secured:
        try:
            secured.settimeout(ALERT_S)
            secured.recv(1)
        except ssl.SSLError as error:
            said = (error.reason or str(error)).lower().replace("_", " ")
            return (
                f"the router does not take the certificate of {identity.name} ({said}): it is "
                "another swarm's, or over"
            )
        except OSError:
            pass  # It has nothing to say against it.
    return ""
