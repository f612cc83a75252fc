"""The settings that each process of a swarm is started with."""

from __future__ import annotations

from collections.abc import Mapping

from deploy.paths import (
    KEYSTORE,
    LLM,
    NET,
    RECORDINGS,
    begun,
    identity_path,
    journal_path,
    net_journal_path,
    site_path,
)
from deploy.roster import Place, Role
from deploy.spec import EMBEDDED, SwarmSpec
from swarm.trust.roles import Role as TrustRole
from worlds.factory.scenarios import link_steps_bps

ROBOT_METRICS_PORT = 9101
EGO_METRICS_PORT = 9102
AUTHORITY_METRICS_PORT = 9108
EGO_THREADS, MANY_EGOS_THREADS = "2", "1"
"""An ego decodes for everybody within a cycle: more than one core helps it, unless others want it,
too."""
SECRETS: Mapping[str, Role] = {
    "COADAPT_QOD_": "controller",
    "COADAPT_LLM_API_KEY": "gateway",
    "COADAPT_LLM_HTTP_": "gateway",
    "COADAPT_CONSOLE_": "console",
}
"""Settings, by how their names begin, that only one role may know."""
API_KEY, API_KEY_FILE = "COADAPT_LLM_API_KEY", "COADAPT_LLM_API_KEY_FILE"
KEPT = (API_KEY, "COADAPT_LLM_HTTP_TOKEN", "COADAPT_QOD_TOKEN", "COADAPT_CONSOLE_TOKEN")
"""Keys and tokens: no file that the project writes holds one. The same name with `_FILE` behind it
names a file of the operator's own that does."""


def inherited(role: Role, environment: Mapping[str, str]) -> dict[str, str]:
    """What a process may take over from the environment of `up`: what is another role's secret
    stays away from it."""
    return {
        name: value
        for name, value in environment.items()
        if all(role == owner or not name.startswith(start) for start, owner in SECRETS.items())
    }


def of_robot(spec: SwarmSpec, place: Place, robot: str) -> dict[str, str]:
    """A robot's settings (`robot_agent.settings`)."""
    return {
        **_environment(spec, place, robot, ROBOT_METRICS_PORT),
        "COADAPT_ROBOTS": robot,
        **_areas_environment(spec),
    }


def of_ego(spec: SwarmSpec, place: Place, ego: str) -> dict[str, str]:
    """An ego's settings (`ego_agent.settings`)."""
    return {
        **_environment(spec, place, TrustRole("ego", ego).common_name, EGO_METRICS_PORT),
        "OMP_NUM_THREADS": MANY_EGOS_THREADS if spec.egos else EGO_THREADS,
        "COADAPT_EGO": ego,
        "COADAPT_POLICY": spec.policy,
        "COADAPT_PERIOD_S": str(spec.period_s),
        "COADAPT_Q_MIN": str(spec.q_min),
        "COADAPT_JOURNAL": journal_path(spec, place.var_dir, ego),
        **_range_environment(spec),
        **_areas_environment(spec),
        # What the operator sets is known before anything has been measured.
        **({"COADAPT_LINK_PRIOR_BPS": str(spec.link_bps)} if spec.link_bps else {}),
        **({"COADAPT_LLM_PROMPT": "short"} if _decides_as_trained(spec) else {}),
    }


def of_controller(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The network controller's settings (`network_controller.settings`)."""
    link = {}
    if spec.link_bps:
        link = {"COADAPT_LINK_BPS": str(spec.link_bps)}
    elif spec.world == "factory" and (steps := link_steps_bps(spec.scenario)) is not None:
        rates, interval_s = steps
        link = {
            "COADAPT_LINK_RATES_BPS": ",".join(map(str, rates)),
            "COADAPT_LINK_INTERVAL_S": str(interval_s),
        }
    return {
        **_site_environment(spec, place, "controller", spec.controller_metrics_port),
        "COADAPT_DRIVER": place.driver,
        **_egos_environment(spec),
        "COADAPT_CELL": spec.cell,
        **standby(spec),
        "COADAPT_EPOCH_NS": str(spec.epoch_ns),
        "COADAPT_STATE_FILE": f"{place.var_dir}/{NET}/shapes-{begun(spec)}.json",
        "COADAPT_NET_JOURNAL": net_journal_path(spec, place.var_dir),
        "COADAPT_QOD_PORT": str(spec.qod_port),
        "COADAPT_QOD_SOCKET": place.qod_socket,
        **link,
    }


def of_gateway(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The LLM gateway's settings (`llm_gateway.settings`)."""
    embedded = spec.llm == EMBEDDED
    return {
        **_site_environment(spec, place, "gateway", spec.gateway_metrics_port),
        "COADAPT_LLM_BACKEND": "llamacpp" if embedded else "openai",
        "COADAPT_LLM_MODEL": spec.llm_model,
        "COADAPT_LLM_CACHE": f"{place.var_dir}/{LLM}/answers.sqlite3",
        "COADAPT_LLM_HTTP_PORT": str(spec.llm_port),
        **({} if embedded else {"COADAPT_LLM_URL": spec.llm}),
        **({"COADAPT_LLM_TRAINED": "true"} if _decides_as_trained(spec) else {}),
    }


def _decides_as_trained(spec: SwarmSpec) -> bool:
    """Whether decisions are the embedded model's that was trained for the short prompt."""
    return spec.llm == EMBEDDED and not spec.llm_model


def of_console(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The console's settings (`options.console.settings`)."""
    return {
        **_site_environment(spec, place, "console", spec.console_metrics_port),
        **_egos_environment(spec),
        **_range_environment(spec),
        "COADAPT_CONSOLE_PORT": str(spec.console_port),
        "COADAPT_CONSOLE_RECORDINGS": f"{place.var_dir}/{RECORDINGS}",
        "COADAPT_CONSOLE_SITE": site_path(place.var_dir),
        **(_prometheus_environment(spec, place) if spec.prometheus else {}),
        "COADAPT_WORLD": spec.world,
        "COADAPT_WORLD_ROBOTS": str(spec.room()),
        "COADAPT_WORLD_SEED": str(spec.seed),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def of_authority(spec: SwarmSpec, place: Place) -> dict[str, str]:
    """The settings of the authority, which renews certificates (`deploy.trust`)."""
    return {
        **_common_environment(spec, place, place.router_host, "authority", AUTHORITY_METRICS_PORT),
        "COADAPT_KEYSTORE": f"{place.var_dir}/{KEYSTORE}",
    }


def standby(spec: SwarmSpec) -> dict[str, str]:
    """Of those that have to know who stands in for the ego."""
    return {"COADAPT_EGO_STANDBY": spec.ego_standby} if spec.ego_standby else {}


def router_address(spec: SwarmSpec, host: str, identity: str) -> str:
    """The router as a client is told of it, which shows an identity where the swarm is secure."""
    if spec.secure:
        return f"tls/{host}:{spec.router_port}#identity={identity}"
    return f"tcp/{host}:{spec.router_port}"


def _environment(
    spec: SwarmSpec, place: Place, common_name: str, metrics_port: int
) -> dict[str, str]:
    """The settings that the processes which live in the world share (`swarm.process`)."""
    return {
        **_common_environment(spec, place, place.router_host, common_name, metrics_port),
        "COADAPT_WORLD": spec.world,
        "COADAPT_WORLD_DATA": place.data,
        "COADAPT_WORLD_ROBOTS": str(spec.room()),
        "COADAPT_WORLD_SEED": str(spec.seed),
        "COADAPT_WORLD_RINGS": str(spec.rings),
        "COADAPT_WORLD_SCENARIO": spec.scenario,
        "COADAPT_WORLD_CACHE": place.cache,
        **({"COADAPT_POSE_ERROR_M": f"{spec.pose_error_m:g}"} if spec.pose_error_m else {}),
        "COADAPT_EPOCH_NS": str(spec.epoch_ns),
        # A machine runs many of these processes: one numerical thread each, and none that spins
        # on a core while it waits for others.
        "OMP_NUM_THREADS": "1",
        "OMP_WAIT_POLICY": "PASSIVE",
        "OPENBLAS_NUM_THREADS": "1",
    }


def _site_environment(
    spec: SwarmSpec, place: Place, common_name: str, metrics_port: int
) -> dict[str, str]:
    """What the processes share that serve the site, not one robot."""
    host = place.site_router_host or place.router_host
    return _common_environment(spec, place, host, common_name, metrics_port) | {
        "COADAPT_METRICS_HOST": place.site_metrics_host
    }


def _common_environment(
    spec: SwarmSpec, place: Place, router_host: str, common_name: str, metrics_port: int
) -> dict[str, str]:
    identity = identity_path(place.var_dir, common_name)
    return {
        "COADAPT_SWARM": spec.swarm,
        "COADAPT_ROUTER": router_address(spec, router_host, identity),
        "COADAPT_METRICS_HOST": "0.0.0.0",
        "COADAPT_METRICS_PORT": str(metrics_port),
        **({"COADAPT_METRICS_TLS": "true"} if spec.metrics_tls else {}),
    }


def _egos_environment(spec: SwarmSpec) -> dict[str, str]:
    """Of those that have to know every ego."""
    return {"COADAPT_EGO": spec.ego} | ({"COADAPT_EGOS": ",".join(spec.egos)} if spec.egos else {})


def _prometheus_environment(spec: SwarmSpec, place: Place) -> dict[str, str]:
    return {
        "COADAPT_CONSOLE_PROMETHEUS": f"http://127.0.0.1:{place.prometheus_host_port}",
        "COADAPT_CONSOLE_PROMETHEUS_LINK": f"http://127.0.0.1:{spec.prometheus_port}",
    }


def _areas_environment(spec: SwarmSpec) -> dict[str, str]:
    return {"COADAPT_AREAS": "1"} if spec.areas else {}


def _range_environment(spec: SwarmSpec) -> dict[str, str]:
    return {"COADAPT_COMM_RANGE_M": str(spec.comm_range_m)} if spec.comm_range_m else {}
