"""The console process: `python -m options.console`."""

from __future__ import annotations

import asyncio
import sys
import threading

from prometheus_client import CollectorRegistry

from options.console.alerts import watch_alerts
from options.console.app import make_app
from options.console.endpoint import Endpoint
from options.console.files import Recordings
from options.console.floor import floor_of
from options.console.metrics import ConsoleMetrics
from options.console.places import SitePlaces
from options.console.prometheus import Prometheus
from options.console.seats import Seats
from options.console.settings import ConsoleSettings, load_settings
from swarm import zenoh_config
from swarm.errors import CoAdaptError
from swarm.http.hosts import Hosts, is_loopback
from swarm.log import make_logger
from swarm.loop_watch import Loops, LoopWatch, keep_turning, unwatched
from swarm.metrics import serve_metrics
from swarm.process import leave, stop_on_signals


def main() -> int:
    """Shows the swarm until SIGTERM or SIGINT; wrong settings end it with 1."""
    stop = stop_on_signals()
    try:
        settings = load_settings()
        zenoh_config.check_router(settings.router, "console")
        endpoint = Endpoint(settings)
        registry = CollectorRegistry()
        server = serve_metrics(registry, settings)
        try:
            loops = LoopWatch(make_logger("console", swarm=settings.swarm)).loop
            asyncio.run(serve(settings, endpoint, registry, stop, loops))
        finally:
            server.close()
    except CoAdaptError as error:
        print(f"console: {error}", file=sys.stderr)
        return 1
    return 0


async def serve(
    settings: ConsoleSettings,
    endpoint: Endpoint,
    registry: CollectorRegistry,
    stop: threading.Event,
    loops: Loops = unwatched,
) -> None:
    """Runs one console until `stop` is set; its metrics go to `registry`."""
    log = make_logger("console", level=settings.log_level, swarm=settings.swarm)
    metrics = ConsoleMetrics(registry)
    server = Prometheus(settings.console_prometheus) if settings.console_prometheus else None
    seats = Seats(settings, server, log)
    floor = floor_of(settings.world, settings.world_robots, settings.world_seed)
    app = make_app(
        seats,
        floor,
        Hosts(settings.console_names, loopback=is_loopback(settings.console_host)),
        settings.console_token,
        metrics,
        log,
        recordings=Recordings(settings.console_recordings),
        places=SitePlaces(settings.console_site, floor.places),
    )
    metrics.show(seats)
    serving = asyncio.create_task(endpoint.serve(app))
    asking = asyncio.create_task(watch_alerts(server, seats)) if server else None
    turning = asyncio.create_task(keep_turning(loops("console", 0.0)))
    log.info("console_up", port=endpoint.port)
    try:
        await _either(serving, stop)
    finally:
        if asking is not None:
            asking.cancel()
        turning.cancel()
        for seat in seats.taken:
            seat.hub.close()
        endpoint.stop()
        await serving
        endpoint.close()
        await asyncio.gather(*(asyncio.to_thread(seat.watch.close) for seat in seats.taken))
    log.info("console_down")


async def _either(serving: asyncio.Task[None], stop: threading.Event) -> None:
    """Until the server has ended by itself, or `stop` is set."""
    loop = asyncio.get_running_loop()
    stopped = asyncio.Event()

    def wait() -> None:
        stop.wait()
        loop.call_soon_threadsafe(stopped.set)

    threading.Thread(target=wait, name="stop", daemon=True).start()
    waiting = asyncio.create_task(stopped.wait())
    await asyncio.wait({serving, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()


if __name__ == "__main__":
    leave(main())
