/** How long to wait before connecting again: from half a second, doubling, to eight, give or take a quarter. */
export function backoffMs(attempt: number, chance: () => number = Math.random): number {
  const base = Math.min(8000, 500 * 2 ** Math.min(attempt, 10));
  return base * (0.75 + 0.5 * chance());
}
