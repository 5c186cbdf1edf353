//! Pages of the bench in a real browser. Marked `ignored` and named `browser_`: tests/run sets up Chromium.

mod chromium;
mod live;
mod pages;
