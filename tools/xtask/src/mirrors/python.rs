//! The Python module.

use anyhow::{Context as _, Result, ensure};
use std::fmt::Write as _;

use super::prose::{Naming, Words, lines};
use super::schema::{Bit, BitValue, Bits, Element, Enumeration, EnumerationValue, Factor, Field, Message, Schema};
use super::{COMMAND, fill, snake, upper};

/// Names in the module.
pub(crate) struct Names;

impl Naming for Names {
    fn constant(&self, name: &str) -> String {
        name.to_owned()
    }

    fn bits(&self, bits: &Bits) -> String {
        format!("{}_*", bits.prefix())
    }

    fn bit(&self, bits: &Bits, bit: &Bit) -> String {
        format!("{}_{}", bits.prefix(), bit.name)
    }

    fn enumeration(&self, enumeration: &Enumeration) -> String {
        upper(&enumeration.name)
    }

    fn value(&self, enumeration: &Enumeration, value: &EnumerationValue) -> String {
        format!("{}[\"{}\"]", upper(&enumeration.name), snake(&value.name))
    }

    fn message(&self, message: &Message) -> String {
        message.name.clone()
    }
}

/// The module by its template.
pub(crate) fn module(schema: &Schema, words: &Words, template: &str) -> Result<String> {
    let parts = [
        ("constants", constants(schema, words)?),
        ("enumerations", enumerations(schema, words)?),
        ("messages", messages(schema, words)?),
        ("layout", layout(schema)?),
    ];
    let made = format!("# Made by `{COMMAND}` from src/messages and rivet_ipc.py.in. Do not edit.\n");
    Ok(made + &fill(template, &parts)?)
}

/// A comment on lines of its own; `mark` is `#` or `#:`.
fn comment(words: &Words, doc: &str, mark: &str) -> Result<String> {
    let text = lines(&words.paragraphs(doc)?, mark.len() + 1);
    Ok(text.iter().map(|line| format!("{mark} {line}").trim_end().to_owned() + "\n").collect())
}

/// A docstring of a class.
fn docstring(words: &Words, doc: &str) -> Result<String> {
    // The quotes at the end stand on the line, too, where it is one.
    let text = lines(&words.paragraphs(doc)?, 10);
    ensure!(
        !text.iter().any(|line| line.contains(['\\']) || line.contains("\"\"\"")),
        "{text:?}: no docstring of Python"
    );
    let end = if text.len() == 1 { "" } else { "\n    " };
    let text = text.join("\n    ").replace("    \n", "\n");
    Ok(format!("    \"\"\"{text}{end}\"\"\"\n"))
}

fn constants(schema: &Schema, words: &Words) -> Result<String> {
    let mut text = String::new();
    for constant in &schema.constants {
        text += &comment(words, &constant.doc, "#:").with_context(|| constant.name.clone())?;
        writeln!(text, "{} = {}", constant.name, constant.value)?;
    }
    for bits in &schema.bits {
        text.push('\n');
        for bit in &bits.bits {
            let name = Names.bit(bits, bit);
            text += &comment(words, &bit.doc, "#:").with_context(|| name.clone())?;
            match bit.value {
                BitValue::Bit(place) => writeln!(text, "{name} = 1 << {place}")?,
                BitValue::Number(number) => writeln!(text, "{name} = {number}")?,
            }
        }
    }
    Ok(text)
}

fn enumerations(schema: &Schema, words: &Words) -> Result<String> {
    let mut text = String::new();
    for enumeration in &schema.enumerations {
        text += &comment(words, &enumeration.doc, "#:").with_context(|| enumeration.name.clone())?;
        let values = enumeration.variants.iter().map(|value| format!("\"{}\": {}", snake(&value.name), value.number));
        writeln!(text, "{} = {{{}}}", upper(&enumeration.name), values.collect::<Vec<_>>().join(", "))?;
    }
    Ok(text)
}

fn messages(schema: &Schema, words: &Words) -> Result<String> {
    let mut texts = Vec::new();
    for message in &schema.messages {
        let mut text = format!("class {}(_Message):\n", message.name);
        text += &docstring(words, &message.doc).with_context(|| message.name.clone())?;
        writeln!(text, "\n    TYPE_NAME = \"{}\"\n    _fields_ = [", message.type_name)?;
        for field in &message.fields {
            text += &comment(words, &field.doc, "        #").with_context(|| field.name.clone())?;
            writeln!(text, "        (\"{}\", {}),", field.name, kind(field))?;
        }
        text.push_str("    ]\n");
        texts.push(text);
    }
    Ok(texts.join("\n\n"))
}

fn layout(schema: &Schema) -> Result<String> {
    let mut text = String::from("LAYOUT = {\n");
    for message in &schema.messages {
        writeln!(text, "    {}: ({}, {{", message.name, message.size)?;
        for field in &message.fields {
            writeln!(text, "        \"{}\": {},", field.name, field.offset)?;
        }
        text.push_str("    }),\n");
    }
    text.push_str("}\n");
    Ok(text)
}

fn kind(field: &Field) -> String {
    let element = match field.element {
        Element::U8 => "ctypes.c_uint8",
        Element::U32 => "ctypes.c_uint32",
        Element::U64 => "ctypes.c_uint64",
        Element::F64 => "ctypes.c_double",
    };
    let factors = field.length.iter().map(|factor| match factor {
        Factor::Constant(name) => name.clone(),
        Factor::Number(number) => number.to_string(),
    });
    let factors = factors.collect::<Vec<_>>();
    match factors.len() {
        0 => element.to_owned(),
        1 => format!("{element} * {}", factors[0]),
        _ => format!("{element} * ({})", factors.join(" * ")),
    }
}
