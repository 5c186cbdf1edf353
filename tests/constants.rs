//! Numbers that the diagnosis was given by judgement are counted: a rule that needs another one pays for it here.

use std::ffi::OsStr;

use syn::{
    Attribute, Expr, ExprIndex, ExprLit, ExprRepeat, ItemConst, ItemMod, Lit, Macro, Type,
    visit::{self, Visit},
};

use crate::{root, sources_of_the_estimator};

/// So many there are, and never more. Forty would be few enough.
const MOST: usize = 112;

/// What ends the line of a number that is not of judgement, and what it means.
const MARKS: [&str; 3] = [
    // A grid, a step, a number of passes, a bound against division by zero: finer ones give the same answers, later.
    "// numerical",
    // A law's figure or an order of magnitude of the world that is flown in, with its source beside it.
    "// physics",
    // A conversion, or a quantile of a distribution of the textbooks.
    "// unit",
];

/// No verdict depends on these.
const AFTER_THE_VERDICT: [&str; 3] = ["next_flight", "next_flight.rs", "trace.rs"];

/// Up to here a number keeps others from being divided by nothing.
const GUARD: f64 = 1e-6;

/// Numbers by line of a file, without those of tests and those that every formula has.
#[derive(Default)]
struct Numbers {
    lines: Vec<usize>,
    /// Within a constant of one number: what was given a name counts, whatever it is.
    named: bool,
}

impl<'ast> Visit<'ast> for Numbers {
    fn visit_expr_lit(&mut self, expression: &'ast ExprLit) {
        let plain = match &expression.lit {
            Lit::Int(number) => matches!(number.base10_parse::<u64>(), Ok(0..=9)),
            Lit::Float(number) => {
                matches!(number.base10_parse::<f64>(), Ok(x) if x <= GUARD || [0.5, 1.0, 2.0].contains(&x))
            }
            _ => return,
        };
        if self.named || !plain {
            self.lines.push(expression.lit.span().start().line);
        }
    }

    fn visit_item_const(&mut self, item: &'ast ItemConst) {
        self.named = !matches!(*item.ty, Type::Array(_));
        visit::visit_item_const(self, item);
        self.named = false;
    }

    fn visit_item_mod(&mut self, module: &'ast ItemMod) {
        if !module.attrs.iter().any(is_of_tests) {
            visit::visit_item_mod(self, module);
        }
    }

    // How many there are, and which of them, is no number of judgement.
    fn visit_expr_index(&mut self, expression: &'ast ExprIndex) {
        self.visit_expr(&expression.expr);
    }

    fn visit_expr_repeat(&mut self, expression: &'ast ExprRepeat) {
        self.visit_expr(&expression.expr);
    }

    fn visit_type(&mut self, _: &'ast Type) {}

    fn visit_macro(&mut self, expression: &'ast Macro) {
        // What is formatted has its numbers in expressions with commas between.
        let parser = syn::punctuated::Punctuated::<Expr, syn::Token![,]>::parse_terminated;
        if let Ok(arguments) = expression.parse_body_with(parser) {
            for argument in &arguments {
                let mut inner = Numbers::default();
                inner.visit_expr(argument);
                self.lines.append(&mut inner.lines);
            }
        }
    }
}

fn is_of_tests(attribute: &Attribute) -> bool {
    attribute.path().is_ident("cfg")
        && matches!(attribute.parse_args::<syn::Path>(), Ok(path) if path.is_ident("test"))
}

#[test]
fn numbers_of_judgement_are_few() {
    let mut found = Vec::new();
    for path in sources_of_the_estimator() {
        let after = |part: &OsStr| AFTER_THE_VERDICT.iter().any(|name| part == *name);
        if path.extension().is_none_or(|extension| extension != "rs") || path.iter().any(after) {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let mut numbers = Numbers::default();
        numbers.visit_file(&syn::parse_file(&text).unwrap());
        let lines: Vec<&str> = text.lines().collect();
        for line in numbers.lines {
            let code = lines[line - 1].trim();
            if !MARKS.iter().any(|mark| code.ends_with(mark)) {
                found.push(format!("{}:{line}: {code}", path.strip_prefix(root()).unwrap().display()));
            }
        }
    }
    assert!(
        found.len() <= MOST,
        "{} numbers of judgement, {MOST} at most:\n{}",
        found.len(),
        found.join("\n")
    );
}
