// Runs the logic of examples/javascript against a run, as its page does: node tests/example.mjs ADDRESS TOKEN
import { World, drawFromAbove } from "../examples/javascript/world.js";

const [address, token] = process.argv.slice(2);

/** What is drawn, instead of a canvas. */
function context() {
  const drawn = [];
  return {
    drawn,
    canvas: { width: 600, height: 600 },
    clearRect: () => (drawn.length = 0),
    beginPath() {},
    fill() {},
    fillText: (name) => drawn.push(name),
    arc() {},
  };
}

/** The first state that is as asked. */
function state(connect, isIt) {
  return new Promise((resolve, reject) => {
    const world = connect((state) => isIt(state) && resolve({ world, state }), reject);
  });
}

const viewer = await state((onState, onEnd) => new World(address, { onState, onEnd }), () => true);
const refused = await viewer.world.command("pause").catch((error) => error.message);
let found;
const { world } = await state(
  (onState, onEnd) =>
    new World(address, { token, rate: 60, onEnd, onState: (state) => (onState(state), found?.(state)) }),
  (state) => state.step > 0,
);
const body = await world.command("spawn", { shape: { ball: { radius: 0.1 } }, position: [0.8, 1, 0.8], name: "mine" });
const spawned = await new Promise((resolve) => {
  found = (state) => state.bodies.some(({ id, name }) => id === body && name === "mine") && resolve(state);
});
const canvas = context();
drawFromAbove(canvas, spawned);
console.log(JSON.stringify({ refused, body, bodies: spawned.bodies.length, drawn: canvas.drawn }));
viewer.world.close();
world.close();
