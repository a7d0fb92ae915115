/** Reasons as an audience may read them. */

/** A reason without sockets and paths, and without the system's own words for it: those are in the program's log. */
export function plain(why: string): string {
  return why
    .replace(/\bat (unix:\S+|\[[^\]]*\]:\d+|[^\s:]+:\d+):\s*/g, "")
    .replace(/: [^:;]*\(os error \d+\)/g, "")
    .replace(/\s*\(os error \d+\)/g, "")
    .replace(/(^|\s)(unix:)?\/(?!dev\/)[^\s:;,]+/g, "$1a file");
}
