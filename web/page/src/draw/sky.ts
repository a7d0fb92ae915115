/** What is behind everything: a sky that is lightest at the horizon, and below it the floor's far end. */
import { BackSide, BufferGeometry, Color, Float32BufferAttribute, Mesh, MeshBasicMaterial, Quaternion, Vector3 } from "three";

/** From below to above: sine of the height above the horizon, and the colour there. */
const BANDS: readonly (readonly [number, number])[] = [
  [-1, 0x5a646f],
  [-0.001, 0x5a646f],
  [0.001, 0x8091a3],
  [0.12, 0x6f8298],
  [0.35, 0x4d5e73],
  [1, 0x2c3848],
];
/** The colour of the floor where it ends. */
export const FAR_FLOOR = BANDS[0][1];
/** Where the clearing colour is seen, if anywhere: a picture before the first rig. */
export const CLEAR = 0x2c3848;

const SEGMENTS = 24;
const RADIUS_M = 50;

/** A sphere round the eye, behind all else. */
export class Sky {
  readonly mesh: Mesh;

  constructor(dithering: boolean) {
    const [positions, colours, index]: [number[], number[], number[]] = [[], [], []];
    const colour = new Color();
    BANDS.forEach(([sine, hex], band) => {
      const across = Math.sqrt(Math.max(0, 1 - sine * sine));
      for (let i = 0; i <= SEGMENTS; i++) {
        const angle = (i / SEGMENTS) * 2 * Math.PI;
        positions.push(RADIUS_M * across * Math.cos(angle), RADIUS_M * sine, RADIUS_M * across * Math.sin(angle));
        colour.setHex(hex).toArray(colours, colours.length);
        if (band === 0 || i === 0) continue;
        const [a, b] = [(band - 1) * (SEGMENTS + 1) + i - 1, band * (SEGMENTS + 1) + i - 1];
        index.push(a, b, a + 1, a + 1, b, b + 1);
      }
    });
    const geometry = new BufferGeometry()
      .setAttribute("position", new Float32BufferAttribute(positions, 3))
      .setAttribute("color", new Float32BufferAttribute(colours, 3))
      .setIndex(index);
    const material = new MeshBasicMaterial({ vertexColors: true, side: BackSide, depthTest: false, depthWrite: false, toneMapped: false, dithering });
    this.mesh = new Mesh(geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = -2000;
  }

  set up(up: Vector3) {
    this.mesh.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), up));
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    (this.mesh.material as MeshBasicMaterial).dispose();
  }
}
