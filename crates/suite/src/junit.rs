//! `JUnit` XML, as Jenkins, GitLab and GitHub's actions read it.
//!
//! A case is a `testsuite`, a test a `testcase` in the class `SUITE.CASE`. A flaky test is a `failure` of the type `flaky`, so that no
//! server takes it for passed. Elements and attributes are those that Jenkins' `junit-10.xsd` knows.

use std::io::{self, Write};

use quick_xml::{
    Writer,
    events::{BytesDecl, BytesText, Event},
};

use crate::{Counts, Outcome, Report, Tested};

/// The report as `JUnit` XML.
pub fn junit(report: &Report) -> String {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    // Writing to memory cannot fail.
    let _ = document(&mut writer, report);
    let mut xml = String::from_utf8_lossy(&writer.into_inner()).into_owned();
    xml.push('\n');
    xml
}

fn document(writer: &mut Writer<impl Write>, report: &Report) -> io::Result<()> {
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let Counts { failed, errors, flaky, .. } = report.counts;
    let mut cases: Vec<&str> = Vec::new();
    for test in &report.tests {
        if !cases.contains(&test.case.as_str()) {
            cases.push(&test.case);
        }
    }
    writer
        .create_element("testsuites")
        .with_attributes([
            ("name", plain(&report.suite).as_str()),
            ("tests", &report.tests.len().to_string()),
            ("failures", &(failed + flaky).to_string()),
            ("errors", &errors.to_string()),
            ("time", &seconds(report.tests.iter().map(took).sum())),
        ])
        .write_inner_content(|writer| {
            cases.iter().try_for_each(|case| {
                let tests: Vec<&Tested> = report.tests.iter().filter(|test| test.case == *case).collect();
                suite(writer, report, case, &tests)
            })
        })?;
    Ok(())
}

fn suite(writer: &mut Writer<impl Write>, report: &Report, case: &str, tests: &[&Tested]) -> io::Result<()> {
    let Counts { failed, errors, flaky, not_run, .. } = Counts::of(tests.iter().map(|test| test.outcome));
    let mut properties: Vec<(String, String)> =
        vec![("bench_version".to_owned(), report.bench_version.clone())];
    properties.extend(report.meta.iter().map(|(key, value)| (format!("meta.{key}"), value.clone())));
    if let Some(test) = tests.first() {
        properties.extend(test.requirements.iter().map(|text| ("requirement".to_owned(), text.clone())));
        properties.extend(test.tags.iter().map(|text| ("tag".to_owned(), text.clone())));
    }
    writer
        .create_element("testsuite")
        .with_attributes([
            ("name", plain(&format!("{}: {case}", report.suite)).as_str()),
            ("tests", &tests.len().to_string()),
            ("failures", &(failed + flaky).to_string()),
            ("errors", &errors.to_string()),
            ("skipped", &not_run.to_string()),
            ("time", &seconds(tests.iter().map(|test| took(test)).sum())),
            ("timestamp", &report.times.began_utc()),
        ])
        .write_inner_content(|writer| {
            writer.create_element("properties").write_inner_content(|writer| {
                properties.iter().try_for_each(|(name, value)| {
                    writer
                        .create_element("property")
                        .with_attributes([("name", plain(name).as_str()), ("value", &plain(value))])
                        .write_empty()
                        .map(drop)
                })
            })?;
            tests.iter().try_for_each(|test| testcase(writer, report, test))
        })?;
    Ok(())
}

fn testcase(writer: &mut Writer<impl Write>, report: &Report, test: &Tested) -> io::Result<()> {
    writer
        .create_element("testcase")
        .with_attributes([
            ("name", plain(&test.id).as_str()),
            ("classname", &plain(&format!("{}.{}", report.suite, test.case))),
            ("time", &seconds(took(test))),
        ])
        .write_inner_content(|writer| {
            let faults = test.faults();
            let first = faults.first().map_or("", String::as_str);
            let (element, kind, message) = match test.outcome {
                Outcome::Passed => ("", "", String::new()),
                Outcome::Failed => ("failure", "limit", first.to_owned()),
                Outcome::Flaky => ("failure", "flaky", format!("flaky: {}; {first}", test.share())),
                Outcome::Error => ("error", "flight", first.to_owned()),
                Outcome::NotRun => ("skipped", "", "the suite was stopped before".to_owned()),
            };
            if !element.is_empty() {
                let mut made = writer.create_element(element);
                if !kind.is_empty() {
                    made = made.with_attribute(("type", kind));
                }
                made.with_attribute(("message", plain(&message).as_str()))
                    .write_text_content(BytesText::new(&plain(&faults.join("\n"))))?;
            }
            writer
                .create_element("system-out")
                .write_text_content(BytesText::new(&plain(&crate::words::detail(test))))?;
            Ok(())
        })?;
    Ok(())
}

fn took(test: &Tested) -> f64 {
    test.runs.iter().map(|run| run.times.took_s).sum()
}

fn seconds(seconds: f64) -> String {
    format!("{seconds:.3}")
}

/// The text without characters that XML cannot hold, not even escaped.
fn plain(text: &str) -> String {
    let is_xml = |c: &char| matches!(c, '\t' | '\n' | '\r' | ' '..='\u{d7ff}' | '\u{e000}'..='\u{fffd}' | '\u{10000}'..);
    text.chars().filter(is_xml).collect()
}
