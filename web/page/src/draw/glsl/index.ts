/** The shaders of the person. One way to the hull for all of them: sphere tracing on silhouette distances. */
export * from "./common.ts";
export * from "./march.ts";
export * from "./passes.ts";
export * from "./surface.ts";
