// Fingers, the mouse and the keyboard on the map: move, zoom, choose a robot.

const CLICK_PX = 5; // A pointer that went no further has not moved anything.

export function listen(map) {
  const { canvas } = map;
  let from = null, begun = null;
  canvas.addEventListener("pointerdown", (e) => {
    from = begun = [e.clientX, e.clientY];
    canvas.setPointerCapture(e.pointerId);
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!from || map.zoom === 1) return;
    map.moveBy(e.clientX - from[0], e.clientY - from[1]);
    from = [e.clientX, e.clientY];
  });
  canvas.addEventListener("pointerup", (e) => {
    if (begun && Math.hypot(e.clientX - begun[0], e.clientY - begun[1]) <= CLICK_PX) map.choose(e.offsetX, e.offsetY);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (from = begun = null));
  canvas.addEventListener("wheel", (e) => {
    // Without the key the page scrolls.
    if (!e.ctrlKey && !e.metaKey) return;
    e.preventDefault();
    map.scaleBy(e.deltaY < 0 ? 1.2 : 1 / 1.2);
  }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    // As with the pointer: there is nothing to move until it is larger than what shows it.
    const step = map.zoom > 1 && { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[e.key];
    if (step) map.moveBy(...step);
    else if (e.key === "+" || e.key === "=") map.scaleBy(1.3);
    else if (e.key === "-") map.scaleBy(1 / 1.3);
    else if (e.key === "0") map.fit();
    else return;
    e.preventDefault();
  });
}
