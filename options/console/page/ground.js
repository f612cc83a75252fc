// The ground that robots see, counted in cells as the ego counts it.

export const CELL_M = 1;

// Cells under equipment are no ground: 1; without a floor plan all are ground.
export function covered(rects, columns, rows, left, low) {
  const cells = new Uint8Array(columns * rows);
  for (const [x, y, right, top] of rects) {
    const first = Math.max(0, Math.ceil((y - low) / CELL_M - 0.5));
    const from = Math.max(0, Math.ceil((x - left) / CELL_M - 0.5));
    for (let row = first; row < rows && low + (row + 0.5) * CELL_M <= top; row++)
      for (let column = from; column < columns && left + (column + 0.5) * CELL_M <= right; column++)
        cells[row * columns + column] = 1;
  }
  return cells;
}

// Marks the cells whose centres a sensor sees: for equal sectors of azimuth from east, how far.
export function markSeen(seen, scene, columns, rows, left, low) {
  const { x, y, visible_m: visible } = scene;
  if (!visible.length) return;
  const reach = Math.max(...visible);
  const first = Math.max(0, Math.floor((y - reach - low) / CELL_M)), lastRow = Math.min(rows, Math.ceil((y + reach - low) / CELL_M));
  const from = Math.max(0, Math.floor((x - reach - left) / CELL_M)), to = Math.min(columns, Math.ceil((x + reach - left) / CELL_M));
  for (let row = first; row < lastRow; row++) {
    const dy = low + (row + 0.5) * CELL_M - y;
    for (let column = from; column < to; column++) {
      const cell = row * columns + column;
      if (seen[cell]) continue;
      const dx = left + (column + 0.5) * CELL_M - x;
      const turn = Math.atan2(dy, dx) / (2 * Math.PI);
      const sector = Math.floor((turn < 0 ? turn + 1 : turn) * visible.length) % visible.length;
      if (dx * dx + dy * dy <= visible[sector] ** 2) seen[cell] = 1;
    }
  }
}
