"""What pages fetch beside themselves: signals, tracks, files of runs, uploads, and the scripts of the package."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError, SchulerError, printable
from schuler.studio import jobs
from schuler.studio.allan import allan_document
from schuler.studio.figures import calibration_figure, figure_document, platform_document, span_figure, sphere_document
from schuler.studio.maps import backdrop_of, map_document
from schuler.studio.signals import COLUMNS, MOST, Views, window
from schuler.studio.tracks import plan
from schuler.studio.uploads import receive, target_of
from schuler.studio.workspace import Workspace

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.responses import Response

#: A report is a page of its own: it may run its script, but is another origin than the workbench.
SANDBOX = "sandbox allow-scripts allow-downloads allow-popups allow-modals; default-src 'none'; " + (
    "script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; frame-ancestors 'self'"
)
_TYPES = {"studio.js": "text/javascript", "studio.css": "text/css"}


def add_routes(app: FastAPI, workspace: Workspace, views: Views) -> None:
    """Add the routes under ``/studio``."""
    from starlette.responses import PlainTextResponse

    def refused(_: Request, error: Exception) -> Response:
        return PlainTextResponse(printable(str(error)), status_code=400)

    app.add_exception_handler(SchulerError, refused)
    app.get("/studio/assets/{name}")(_typed(_asset))
    _add_signals(app, views)
    _add_calibrations(app, workspace)
    _add_tracks(app, workspace, views)
    _add_studies(app, workspace)
    _add_files(app, workspace)


def _typed(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function for FastAPI, which would look for the class of its response where it is not imported."""
    function.__annotations__.pop("return", None)
    return function


def _asset(name: str) -> Response:
    """A script or style of the package."""
    from starlette.responses import PlainTextResponse, Response

    cached = {"cache-control": "no-cache"}
    if name == "plotly.js":
        data = (resources.files("schuler.plotting") / "assets" / "plotly-basic.min.js.gz").read_bytes()
        return Response(data, media_type="text/javascript", headers={"content-encoding": "gzip", **cached})
    if name not in _TYPES:
        return PlainTextResponse("no such file", status_code=404)
    text = (resources.files("schuler.studio") / "assets" / name).read_text(encoding="utf-8")
    return Response(text, media_type=_TYPES[name], headers=cached)


def _add_signals(app: FastAPI, views: Views) -> None:
    """Signals of a log over a window of time, and figures of a span."""
    from starlette.responses import JSONResponse

    def signals(
        key: str, start: float | None = None, stop: float | None = None, only: str = "", columns: int = COLUMNS
    ) -> Response:
        seen = views.get(key)
        first, last = seen.span
        shown = window(
            seen, first if start is None else start, last if stop is None else stop, min(max(columns, 1), MOST)
        )
        wanted = [panel for panel in shown["panels"] if panel["label"].startswith(only)] or shown["panels"][:1]
        return JSONResponse(shown | {"panels": wanted if only else shown["panels"], "span": [first, last]})

    def span_figure_of(key: str, name: str, start: float, stop: float) -> Response:
        return JSONResponse(figure_document(span_figure(views.get(key), name, start, stop)))

    app.get("/studio/views/{key}/signals")(_typed(signals))
    app.get("/studio/views/{key}/{name}")(_typed(span_figure_of))


def _add_calibrations(app: FastAPI, workspace: Workspace) -> None:
    """Figures of a calibration, and the sphere of its poses."""
    from starlette.responses import JSONResponse

    def sphere(run: str) -> Response:
        return JSONResponse(sphere_document(CalibrationResult.from_yaml(workspace.inside(run) / "calibration.yaml")))

    def calibration_figure_of(name: str, run: str) -> Response:
        result = CalibrationResult.from_yaml(workspace.inside(run) / "calibration.yaml")
        return JSONResponse(figure_document(calibration_figure(result, name)))

    app.get("/studio/calibrations/sphere")(_typed(sphere))
    app.get("/studio/calibrations/{name}")(_typed(calibration_figure_of))


def _add_tracks(app: FastAPI, workspace: Workspace, views: Views) -> None:
    """Tracks of logs and runs, and the map below them."""
    from starlette.responses import JSONResponse

    def curves(view: str, run: str, other: str) -> dict[str, Any]:
        recording = views.get(view).recording if view else None
        return plan(recording, *(workspace.inside(name) if name else None for name in (run, other)))

    def track(view: str = "", run: str = "", other: str = "") -> Response:
        return JSONResponse(curves(view, run, other))

    def background(view: str = "", run: str = "", other: str = "", name: str = "") -> Response:
        drawn = curves(view, run, other)
        if drawn["origin"] is None:
            raise InputError("map: expected a track, there is none yet")
        north, east = (np.concatenate([c[axis] for c in drawn["curves"]]) for axis in ("north", "east"))
        return JSONResponse(map_document(backdrop_of(workspace, name), np.array(drawn["origin"]), north, east))

    app.get("/studio/track")(_typed(track))
    app.get("/studio/map")(_typed(background))


def _add_studies(app: FastAPI, workspace: Workspace) -> None:
    """Allan curves of an identification, and a platform that turns."""
    from starlette.responses import JSONResponse

    def noise(key: str, axis: str, sheet: str = "") -> Response:
        try:
            answer = jobs.answer(workspace, key)
        except (OSError, ValueError):
            raise InputError("this identification is no longer kept: start it again") from None
        return JSONResponse(allan_document(answer, axis, sheet))

    def platform(name: str) -> Response:
        from schuler.rotary.search.scenario import RotaryScenario

        scenario = RotaryScenario.load(workspace.inside(name))
        return JSONResponse(platform_document(scenario.rotary.schedule.build(), scenario.motion.build().duration))

    app.get("/studio/noise")(_typed(noise))
    app.get("/studio/platform")(_typed(platform))


def _add_files(app: FastAPI, workspace: Workspace) -> None:
    """Files of runs, and files that are put into the folder."""
    # FastAPI finds what to pass by the class, which this module does not import before it is needed
    from starlette.requests import Request as RequestClass
    from starlette.responses import FileResponse, JSONResponse, PlainTextResponse

    def file(name: str) -> Response:
        path = workspace.inside(name)
        if not path.is_file():
            return PlainTextResponse("no such file", status_code=404)
        return FileResponse(path, headers={"content-security-policy": SANDBOX, "cache-control": "no-store"})

    async def upload(name: str, request: Any) -> Response:
        stated = request.headers.get("content-length", "")
        size = int(stated) if stated.isdigit() else None
        written = await receive(target_of(workspace, name, size), request.stream(), size)
        return JSONResponse({"name": name, "bytes": written})

    upload.__annotations__["request"] = RequestClass
    app.get("/studio/files/{name:path}")(_typed(file))
    app.put("/studio/uploads/{name}")(_typed(upload))
