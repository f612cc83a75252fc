"""Roles, their rights, and the access control that is written from them."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import pytest
import zenoh

from swarm import keyspace, zenoh_config
from swarm.errors import IdentityError, SettingError
from swarm.trust.access import UNIX, access_control
from swarm.trust.rights import Right, rights_of
from swarm.trust.roles import LOCAL, SITE, Role, operator_of, role_of

SWARM = "qa"
EVERYBODY = [
    *map(role_of, SITE),
    Role("robot", "R1"),
    Role("ego", "R1"),
    Role("controller", "R1"),
    Role("operator", "ann"),
    Role("reader", "bob"),
]
TOKENS = (keyspace.alive, keyspace.ego_leads, keyspace.llm_alive, keyspace.metrics)


def key_functions() -> list[Callable[..., str]]:
    found: list[Callable[..., str]] = []
    for _, function in inspect.getmembers(keyspace, inspect.isfunction):
        parameters = list(inspect.signature(function).parameters)
        if parameters[:1] == ["swarm"] and not function.__name__.startswith("_"):
            found.append(function)
    return found


def key_of(function: Callable[..., str]) -> str:
    wanted = len(inspect.signature(function).parameters)
    return function(SWARM, *["R1"] * (wanted - 1))


def allows(role: Role, act: str, key: str) -> bool:
    return any(
        right.act == act and zenoh.KeyExpr(right.key).includes(zenoh.KeyExpr(key))
        for right in rights_of(role, SWARM)
    )


@pytest.mark.parametrize("function", key_functions(), ids=lambda f: f.__name__)
def test_every_key_has_one_who_speaks_and_one_who_hears(function: Callable[..., str]) -> None:
    key = key_of(function)
    speakers = [
        role for role in EVERYBODY for act in ("put", "serve", "hold") if allows(role, act, key)
    ]
    hearers = [
        role for role in EVERYBODY for act in ("listen", "ask", "watch") if allows(role, act, key)
    ]
    # The router tells of its own connections, and is not subject to its own rules.
    assert speakers or function is keyspace.net_tcp
    # So it hears, too, where metrics are.
    assert hearers or function is keyspace.metrics
    if function in TOKENS:
        assert all(allows(role, "hold", key) for role in speakers)


def test_there_are_as_many_key_functions_as_keys() -> None:
    keys = {key_of(function) for function in key_functions()}
    assert len(keys) == len(key_functions()) == 20


@pytest.mark.parametrize("role", EVERYBODY, ids=lambda r: r.common_name)
def test_nobody_speaks_for_another_robot(role: Role) -> None:
    for right in rights_of(role, SWARM):
        if right.act in ("put", "serve", "hold"):
            place = keyspace.metrics(SWARM, role.common_name)
            if (right.act, right.key) == ("hold", place):
                continue  # One's own, wherever that is.
            # Of a robot's own, whatever the algorithm, and in whatever cell of the floor it is.
            own = right.key.removesuffix("/robot/R1/shared/*").removesuffix("/**")
            assert "*" not in own
            assert "/robot/" not in right.key or role == Role("robot", "R1")
            assert "/ego/" not in right.key or role == Role("ego", "R1")


def test_a_reader_changes_nothing() -> None:
    rights = rights_of(Role("reader", "bob"), SWARM)
    own = Right("ask", keyspace.trust_certificate(SWARM))
    assert {right.act for right in rights if right != own} == {"listen", "watch"}


@pytest.mark.parametrize("role", [*EVERYBODY, LOCAL], ids=lambda r: r.common_name)
def test_a_common_name_says_the_role(role: Role) -> None:
    assert role_of(role.common_name) == role


@pytest.mark.parametrize(
    "name", ["", "R 1", "ego-", "operator-", "a/b", "R*", "x" * 33, "ego-" + "x" * 29]
)
def test_other_names_are_no_roles(name: str) -> None:
    with pytest.raises(IdentityError, match="it must be a robot's id, router"):
        role_of(name)


def test_any_user_is_an_operator_with_a_name_that_fits_a_key() -> None:
    assert operator_of("ann@site.example") == Role("operator", "ann-site-example")
    assert operator_of("").common_name == "operator-unknown"
    assert role_of(operator_of("x" * 200).common_name).kind == "operator"


def test_the_access_control_denies_what_no_rule_allows() -> None:
    access = access_control(SWARM, EVERYBODY, LOCAL)
    assert access["enabled"] is True
    assert access["default_permission"] == "deny"
    assert {rule["permission"] for rule in access["rules"]} == {"allow"}
    ids = [rule["id"] for rule in access["rules"]]
    assert len(ids) == len(set(ids))
    used = [rule for policy in access["policies"] for rule in policy["rules"]]
    assert sorted(used) == sorted(ids)
    for subject in access["subjects"]:
        names = subject.get("cert_common_names")
        assert subject["link_protocols"] == (["tls"] if names else ["unixsock-stream"])


def test_no_role_is_taken_for_who_comes_over_the_unix_socket() -> None:
    access = access_control(SWARM, [*EVERYBODY, Role("robot", "local")], LOCAL)
    for kind in ("rules", "subjects"):
        ids = [one["id"] for one in access[kind]]
        assert len(ids) == len(set(ids))


def test_each_asks_by_its_own_name_only() -> None:
    access = access_control(SWARM, EVERYBODY, LOCAL)
    asked = {
        rule["id"].split()[0]: rule["key_exprs"]
        for rule in access["rules"]
        if rule["messages"] == ["query"] and rule["flows"] == ["ingress"]
    }
    names = {role.common_name for role in EVERYBODY}
    assert set(asked) == names - {"router", "authority"} | {UNIX}
    for name, keys in asked.items():
        own = LOCAL.common_name if name == UNIX else name
        assert {keyspace.asker_of(key) for key in keys} == {own}


def test_a_router_address_names_an_identity_where_it_is_secure() -> None:
    router = "tls/10.0.0.1:7447#identity=/keys/R3"
    identity = zenoh_config.identity_of(router)
    assert identity is not None
    assert identity.name == "R3"
    assert zenoh_config.expected_links(zenoh_config.client_config(router)) == 3
    local = "unixsock-stream//run/r.sock#identity=/keys/operator-local"
    assert zenoh_config.client_config(local)["connect/endpoints"] == ["unixsock-stream//run/r.sock"]
    assert zenoh_config.identity_of("tcp/10.0.0.1:7447") is None


@pytest.mark.parametrize(
    "router",
    ["tls/10.0.0.1:7447", "tcp/10.0.0.1:7447#identity=/keys/R3", "tls/10.0.0.1:7447#identity=keys"],
)
def test_tls_goes_with_an_identity_and_nothing_else_does(router: str) -> None:
    with pytest.raises(SettingError, match="tls/HOST:PORT#identity=FOLDER"):
        zenoh_config.client_config(router)


def test_a_process_shows_its_own_identity() -> None:
    with pytest.raises(IdentityError, match="names the identity of 'R2', and this process is 'R3'"):
        zenoh_config.check_router("tls/10.0.0.1:7447#identity=/keys/R2", "R3")
