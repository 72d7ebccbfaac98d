"""The style sheet of the documentation page."""

from __future__ import annotations

from typing import Final

CSS: Final = """
:root { color-scheme: light dark;
  --ink: #1c2430; --soft: #5b6675; --line: #dde2e8; --paper: #ffffff; --shade: #f5f7f9;
  --accent: #0b6e75; --read: #0b6e75; --write: #8a4b08; --danger: #a4262c; --admin: #5b3a8c; }
@media (prefers-color-scheme: dark) { :root {
  --ink: #e4e8ee; --soft: #9aa5b3; --line: #313945; --paper: #14181e; --shade: #1c222a;
  --accent: #5cc4cb; --read: #5cc4cb; --write: #e0a35a; --danger: #f08a8f; --admin: #b79af0; } }
* { box-sizing: border-box; }
html { scroll-padding-top: 1rem; }
body { margin: 0; color: var(--ink); background: var(--paper);
  font: 15px/1.55 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
.page { display: grid; grid-template-columns: 18.5rem minmax(0, 1fr); max-width: 84rem;
  margin: 0 auto; }
nav { position: sticky; top: 0; align-self: start; max-height: 100vh; overflow-y: auto;
  padding: 1.6rem 1rem 2rem 1.5rem; border-right: 1px solid var(--line); font-size: 13px; }
nav h2 { margin: 1.1rem 0 .3rem; font-size: 11px; letter-spacing: .06em;
  text-transform: uppercase; color: var(--soft); font-weight: 600; }
nav ul { list-style: none; margin: 0; padding: 0; }
nav a { display: block; padding: .13rem 0; color: var(--ink); text-decoration: none; }
nav a:hover { color: var(--accent); text-decoration: underline; }
nav .title { font-size: 17px; font-weight: 650; }
main { padding: 1.6rem 2.5rem 5rem; min-width: 0; }
h1 { margin: 0 0 .2rem; font-size: 1.9rem; line-height: 1.2; }
.lead { font-size: 1.05rem; margin: .2rem 0 1rem; max-width: 46rem; }
.note { color: var(--soft); max-width: 46rem; margin: .4rem 0; }
h2.section { margin: 2.6rem 0 .8rem; font-size: 1.25rem; padding-bottom: .3rem;
  border-bottom: 1px solid var(--line); }
h4 { margin: 1.1rem 0 .35rem; font-size: 12px; letter-spacing: .05em; text-transform: uppercase;
  color: var(--soft); font-weight: 600; }
details.call { border: 1px solid var(--line); border-radius: 7px; margin: .5rem 0; }
details.call > summary { cursor: pointer; list-style: none; padding: .55rem .9rem;
  display: flex; flex-wrap: wrap; gap: .2rem .8rem; align-items: baseline; }
details.call > summary::-webkit-details-marker { display: none; }
details.call > summary:hover, details.call[open] > summary { background: var(--shade); }
details.call[open] > summary { border-bottom: 1px solid var(--line); }
details.call > div { padding: .6rem .9rem 1rem; }
summary .what { color: var(--soft); flex: 1 1 14rem; }
summary:focus-visible, a:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
code, pre { font: 13px/1.5 ui-monospace, "SFMono-Regular", Menlo, Consolas, "DejaVu Sans Mono",
  monospace; }
summary code { font-size: 14px; overflow-wrap: anywhere; }
pre { margin: 0; padding: .7rem .9rem; background: var(--shade); border-radius: 6px;
  overflow-x: auto; }
.method { display: inline-block; min-width: 4.1rem; font: 700 12px/1.5 ui-monospace, Menlo,
  Consolas, "DejaVu Sans Mono", monospace; color: var(--read); }
.method.post, .method.patch, .method.put { color: var(--write); }
.method.delete { color: var(--danger); }
.scope { font-size: 12px; padding: 0 .5rem; border: 1px solid currentColor; border-radius: 99px;
  color: var(--read); }
.scope.write, .scope.train { color: var(--write); }
.scope.admin, .scope.metrics { color: var(--admin); }
.scope.open { color: var(--soft); }
table { border-collapse: collapse; width: 100%; font-size: 14px; }
th { text-align: left; font-weight: 600; color: var(--soft); font-size: 12px; }
th, td { padding: .32rem .8rem .32rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }
td.name { white-space: nowrap; width: 1%; }
td.type { color: var(--soft); width: 34%; }
tr:last-child td { border-bottom: 0; }
.required { color: var(--danger); font-size: 12px; }
a { color: var(--accent); }
p { max-width: 46rem; margin: .4rem 0; }
@media (max-width: 60rem) { .page { display: block; } nav { display: none; }
  main { padding: 1.2rem 1rem 3rem; } td.type { width: auto; } }
"""
