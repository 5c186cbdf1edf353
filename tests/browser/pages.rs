//! Pages of results: they open without an error, fetch nothing, draw their plots, and fit a phone.

use std::{path::Path, process::Command};

use crate::chromium::Chromium;

const WIDE: [u32; 2] = [1280, 1000];
const PHONE: [u32; 2] = [390, 844];

fn bench(folder: &Path, line: &str, code: i32) {
    let output = Command::new(env!("CARGO_BIN_EXE_bench"))
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .args(line.split(' '))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(code), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_opens_every_page_of_results_without_an_error_or_a_request() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    bench(folder, "sim -o a.mcap", 0);
    bench(folder, "sim --effect rotor-lag:time_constant_s=0.12 --seed 2 -o b.mcap", 0);
    bench(folder, "sim --mission hop -o hop.mcap", 0);
    bench(folder, "report a.mcap b.mcap --diff --diagnose -o report.html", 0);
    bench(folder, "diff a.mcap b.mcap --html diff.html", 1);
    bench(folder, "diagnose b.mcap --html diagnosis.html", 0);
    // Within the tolerances of the built-in rig a hop tells nothing.
    bench(folder, "verify hop.mcap --html verify.html", 1);
    bench(folder, "paper -o paper", 0);

    let mut browser = Chromium::start();
    for page in ["report", "diff", "diagnosis", "verify", "paper/index"] {
        let url = format!("file://{}", folder.join(format!("{page}.html")).display());
        let tab = browser.open(&url, WIDE);
        for size in [WIDE, PHONE] {
            browser.resize(&tab, size);
            let in_sight = "(e => { const r = e.getBoundingClientRect(); return r.height > 0 && r.top < innerHeight && r.bottom > 0; })";
            browser.wait(
                &tab,
                "the plots in sight to be drawn",
                &format!("[...document.querySelectorAll('[data-plot]')].filter({in_sight}).every(e => e.dataset.plot === 'drawn')"),
            );
            let over = browser.value(&tab, "document.documentElement.scrollWidth - innerWidth");
            assert_eq!(over, 0, "{page} is wider than {size:?}");
            browser.screenshot(&tab, &format!("page-{}-{}", page.replace('/', "-"), size[0]));
        }
        browser.dark(&tab, true);
        browser.screenshot(&tab, &format!("page-{}-dark", page.replace('/', "-")));
        assert_eq!(browser.errors(&tab), Vec::<String>::new(), "{page}");
        assert_eq!(browser.requests(&tab).join(" "), url, "{page} is all in itself");
    }
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_zooms_a_plot_and_shows_all_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    bench(folder, "sim -o a.mcap", 0);
    bench(folder, "report a.mcap -o report.html", 0);
    let mut browser = Chromium::start();
    let tab = browser.open(&format!("file://{}", folder.join("report.html").display()), WIDE);
    browser.wait(&tab, "the first plot", "document.querySelector('[data-plot]').dataset.plot === 'drawn'");
    let press = |browser: &mut Chromium, key: &str| {
        let event = format!("new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }})");
        browser.value(&tab, &format!("document.querySelector('[data-plot]').dispatchEvent({event})"));
    };
    // What is on the canvas of the first plot.
    let drawn = "document.querySelector('[data-plot] canvas').toDataURL()";
    browser.value(&tab, &format!("window.whole = {drawn}"));
    press(&mut browser, "+");
    browser.wait(&tab, "the plot to zoom", &format!("{drawn} !== whole"));
    press(&mut browser, "Escape");
    browser.wait(&tab, "the plot to show all again", &format!("{drawn} === whole"));
    assert_eq!(browser.errors(&tab), Vec::<String>::new());
}

#[test]
#[ignore = "needs Chromium; tests/run sets it up"]
fn browser_zooms_and_pans_a_plot_by_fingers_on_a_phone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    bench(folder, "sim -o a.mcap", 0);
    bench(folder, "report a.mcap -o report.html", 0);
    let mut browser = Chromium::start();
    let tab = browser.open(&format!("file://{}", folder.join("report.html").display()), PHONE);
    // On a phone the first plot is far below the first screen, and only what comes near is drawn.
    browser.value(
        &tab,
        "document.querySelector('[data-plot]').scrollIntoView({ block: 'center', behavior: 'instant' })",
    );
    browser.wait(&tab, "the first plot", "document.querySelector('[data-plot]').dataset.plot === 'drawn'");
    let place = "(() => { const box = document.querySelector('[data-plot] .u-over').getBoundingClientRect(); \
         return [box.left, box.top + box.height / 2, box.width]; })()";
    let place = browser.value(&tab, place);
    let [left, y, width] = [0, 1, 2].map(|i| place[i].as_f64().unwrap());
    let at = |share: f64| [left + share * width, y];
    let drawn = "document.querySelector('[data-plot] canvas').toDataURL()";
    let keep =
        |browser: &mut Chromium, name: &str| _ = browser.value(&tab, &format!("window.{name} = {drawn}"));
    keep(&mut browser, "whole");
    // One finger moves nothing where all is shown.
    browser.drag(&tab, &[at(0.7)], &[at(0.3)]);
    assert_eq!(browser.value(&tab, &format!("{drawn} === whole")), true);
    browser.drag(&tab, &[at(0.45), at(0.55)], &[at(0.2), at(0.8)]);
    browser.wait(&tab, "two fingers to zoom", &format!("{drawn} !== whole"));
    keep(&mut browser, "zoomed");
    browser.screenshot(&tab, "report-phone-zoomed");
    browser.drag(&tab, &[at(0.7)], &[at(0.3)]);
    browser.wait(&tab, "one finger to pan", &format!("{drawn} !== zoomed && {drawn} !== whole"));
    // The page itself was neither zoomed nor moved, and fingers that meet again show all.
    assert_eq!(browser.value(&tab, "visualViewport.scale"), 1);
    for _ in 0..3 {
        browser.drag(&tab, &[at(0.1), at(0.9)], &[at(0.45), at(0.55)]);
    }
    browser.wait(&tab, "two fingers to show all again", &format!("{drawn} === whole"));
    assert_eq!(browser.errors(&tab), Vec::<String>::new());
}
