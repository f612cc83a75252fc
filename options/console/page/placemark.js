// How places of the site are drawn on the map, and one that is being drawn.

// With their names, each in the middle of its corners.
export function drawPlaces(c, places, at, theme) {
  c.strokeStyle = c.fillStyle = theme("--quiet");
  c.font = "12px system-ui, sans-serif";
  c.textAlign = "center";
  c.setLineDash([4, 4]);
  for (const { name, polygon } of places) {
    const corners = polygon.map(([x, y]) => at(x, y));
    trace(c, corners);
    c.closePath();
    c.stroke();
    const middle = (axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length;
    c.fillText(name, middle(0), middle(1));
  }
  c.setLineDash([]);
}

// Its corners so far, the first one larger: a click there closes it.
export function drawOutline(c, { corners, closed }, at, theme) {
  const points = corners.map(([x, y]) => at(x, y));
  c.strokeStyle = c.fillStyle = theme("--chosen");
  c.lineWidth = 2;
  trace(c, points);
  if (closed) c.closePath();
  c.stroke();
  if (points.length > 2) {
    c.globalAlpha = 0.15;
    c.fill();
    c.globalAlpha = 1;
  }
  points.forEach(([x, y], i) => {
    c.beginPath();
    c.arc(x, y, i ? 3 : 6, 0, 2 * Math.PI);
    c.fill();
  });
  c.lineWidth = 1;
}

function trace(c, points) {
  c.beginPath();
  for (const [x, y] of points) c.lineTo(x, y);
}
