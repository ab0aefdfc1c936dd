// Colours of the page's style sheet, read once for each scheme.
const hues = new Map();
const hue = (name) => {
  if (!hues.has(name)) hues.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return hues.get(name);
};
const channels = (colour) => [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
const mixed = (from, to, share) => channels(from).map((value, c) => Math.round(value + share * (channels(to)[c] - value)));
const css = ([red, green, blue]) => `rgb(${red} ${green} ${blue})`;
// Losses of quality with the first and with the last colour.
const LOST = [0.05, 0.4], SHADES = 12;

// The shade of a cell, given its quality before and now: -1 if it lost none, `SHADES` if it is inside out.
function shade(before, now) {
  if (now < 0) return SHADES;
  const share = (before - now - LOST[0]) / (LOST[1] - LOST[0]);
  return share < 0 ? -1 : Math.min(SHADES - 1, Math.floor(share * SHADES));
}
