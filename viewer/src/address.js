// The address of a view: everything but the key, so that it can be sent to a colleague.

export function readAddress() {
  return Object.fromEntries(new URLSearchParams(location.search).entries());
}

// `state`: { frame, colour, gains, isSentShown, areDataShown }; the frame is "" while it plays.
export function writeAddress({ frame, colour, usualColour, gains, isSentShown, areDataShown }) {
  const query = new URLSearchParams(location.search);
  const own = Array.from(gains, (gain) => Math.round(gain * 100) / 100);
  const set = (name, value) => (value ? query.set(name, value) : query.delete(name));
  set("frame", frame);
  set("colour", colour === usualColour ? "" : colour);
  set("gains", own.every((gain) => gain === 1) ? "" : own.join(","));
  set("sent", isSentShown ? "" : "0");
  set("data", areDataShown ? "" : "0");
  history.replaceState(null, "", `${location.pathname}?${query}`.replace(/\?$/, ""));
}
