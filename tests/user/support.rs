use std::{
    fs,
    io::{self, BufRead as _, BufReader, Read as _},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Stdio},
    time::Duration,
};

use assert_cmd::{Command, assert::Assert};
use scraper::{ElementRef, Html, Selector};
use tungstenite::{ClientRequestBuilder, WebSocket};

/// The project's folder, where the README's commands are run.
pub fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// `bench` with arguments, from the project's folder.
pub fn bench<I: IntoIterator<Item = S>, S: AsRef<std::ffi::OsStr>>(arguments: I) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bench"));
    command.current_dir(root()).args(arguments);
    command
}

/// A folder for one test's files.
pub struct Scratch(tempfile::TempDir);

impl Scratch {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The same as text, for command lines.
    pub fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// Flies a mission into a file and returns its name.
    pub fn fly(&self, file: &str, arguments: &[&str]) -> String {
        let name = self.name(file);
        bench(["sim", "-o", &name, "--force"]).args(arguments).assert().success();
        name
    }
}

/// `bench` that serves something while it flies. It ends with its test.
pub struct Serving {
    process: Child,
    words: BufReader<ChildStderr>,
    /// Where it serves, as it says behind certain words.
    pub address: String,
}

impl Serving {
    pub fn start(arguments: &[&str], says: &str) -> Self {
        let mut process = std::process::Command::new(env!("CARGO_BIN_EXE_bench"))
            .current_dir(root())
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut words = BufReader::new(process.stderr.take().unwrap());
        let address = loop {
            let mut line = String::new();
            assert!(words.read_line(&mut line).unwrap() > 0, "it ended before it told its address");
            if let Some(address) = line.strip_prefix(says) {
                break address.trim().to_owned();
            }
        };
        Self { process, words, address }
    }

    /// A connection to the server on a host and port.
    pub fn connect(host: &str, request: ClientRequestBuilder) -> WebSocket<TcpStream> {
        let stream = TcpStream::connect(host).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        tungstenite::client(request, stream).unwrap().0
    }

    /// As Ctrl-C does.
    pub fn interrupt(&self) {
        let id = self.process.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    }

    /// Exit code and what was printed, once it has ended by itself.
    pub fn end(mut self) -> (Option<i32>, Vec<u8>) {
        let mut printed = Vec::new();
        self.process.stdout.take().unwrap().read_to_end(&mut printed).unwrap();
        io::copy(&mut self.words, &mut io::sink()).unwrap();
        (self.process.wait().unwrap().code(), printed)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Standard output as JSON, which must be as its schema says.
pub fn json(assert: &Assert) -> serde_json::Value {
    let value = serde_json::from_slice(&assert.get_output().stdout).unwrap();
    conforms(&value);
    value
}

/// Holds what a command printed against the schema in `docs/schemas` that it names.
pub fn conforms(value: &serde_json::Value) {
    let name = value["schema"].as_str().expect("an output names its schema");
    let file = root().join("docs/schemas").join(format!("{}.json", name.replace('/', ".")));
    let text = std::fs::read(&file).unwrap_or_else(|error| {
        panic!(
            "{name} has no schema: {}: {error}; docs/schemas/README.md tells how to write one",
            file.display()
        )
    });
    let schema = serde_json::from_slice(&text).unwrap();
    let wrong = violations(&schema, value);
    assert!(
        wrong.is_empty(),
        "the output is not as {} says; docs/schemas/README.md tells how to bring them together:\n{}",
        file.display(),
        wrong.join("\n")
    );
}

/// What a JSON Schema refuses about a value.
pub fn violations(schema: &serde_json::Value, value: &serde_json::Value) -> Vec<String> {
    let validator = jsonschema::draft202012::new(schema).expect("the schema is one");
    validator.iter_errors(value).map(|error| format!("{}: {error}", error.instance_path())).collect()
}

pub fn stdout(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stdout.clone()).unwrap()
}

/// Standard error of a command that must fail with `code`, without a panic.
pub fn refused(mut command: Command, code: i32) -> String {
    let assert = command.assert().code(code);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains("error: ") && !words.contains("panicked"), "{words}");
    assert!(words.matches("os error").count() < 2, "a cause is told twice: {words}");
    words
}

/// A recording that was cut or never closed says so, with what to do.
pub fn unclosed(recording: &str) {
    let assert = bench(["info", recording]).assert().code(3);
    let words = String::from_utf8(assert.get_output().stderr.clone()).unwrap();
    assert!(words.contains("was not closed") && words.contains("bench recover"), "{words}");
}

/// A page as a browser sees it. It must be sound HTML that loads nothing.
pub struct Page {
    html: Html,
    /// Its size.
    pub bytes: usize,
}

fn all<'a>(html: &'a Html, selector: &str) -> Vec<ElementRef<'a>> {
    html.select(&Selector::parse(selector).unwrap()).collect()
}

fn text(element: ElementRef<'_>) -> String {
    element.text().collect::<String>().split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Page {
    pub fn read(file: &str) -> Self {
        let bytes = fs::read_to_string(file).unwrap();
        let html = Html::parse_document(&bytes);
        assert_eq!(
            html.errors.iter().filter(|error| !error.contains("doctype")).collect::<Vec<_>>(),
            [""; 0]
        );
        let policy = all(&html, "meta[http-equiv='Content-Security-Policy']");
        assert!(policy[0].attr("content").unwrap().starts_with("default-src 'none'"));
        for loads in ["[src]", "link:not([href='data:,'])", "iframe", "object"] {
            assert!(all(&html, loads).is_empty(), "{loads}");
        }
        let page = Self { html, bytes: bytes.len() };
        let is_no_number = |word: &str| ["nan", "inf", "infinity"].contains(&word.to_lowercase().as_str());
        let words = page.texts("main").concat();
        assert!(!words.split(|c: char| !c.is_alphanumeric()).any(is_no_number), "{words}");
        page
    }

    pub fn texts(&self, selector: &str) -> Vec<String> {
        all(&self.html, selector).into_iter().map(text).collect()
    }

    /// The verdict on top.
    pub fn headline(&self) -> String {
        let [headline] = self.texts("h1").try_into().expect("one headline");
        headline
    }

    /// An attribute of every element.
    pub fn attributes(&self, selector: &str, name: &str) -> Vec<String> {
        all(&self.html, selector).iter().filter_map(|found| found.attr(name)).map(str::to_owned).collect()
    }

    /// The text of the sections below a title.
    pub fn section(&self, title: &str) -> String {
        let titles = all(&self.html, "section > h2, section > h3");
        let found = titles.into_iter().find(|found| text(*found) == title);
        let found = found.unwrap_or_else(|| panic!("no section {title}: {:?}", self.texts("h2, h3")));
        text(ElementRef::wrap(found.parent().unwrap()).unwrap())
    }

    /// The data of every plot: numbers that JSON can hold.
    pub fn plots(&self) -> Vec<serde_json::Value> {
        let data = all(&self.html, "figure[data-plot] > script[type='application/json']");
        data.into_iter().map(|data| serde_json::from_str(&data.inner_html()).unwrap()).collect()
    }

    /// What the y axes of all plots show.
    pub fn panels(&self) -> Vec<String> {
        let of = |plot: &serde_json::Value| plot["panels"].as_array().unwrap().clone();
        self.plots().iter().flat_map(of).map(|panel| panel["title"].as_str().unwrap().to_owned()).collect()
    }
}
