//! The C header.

use anyhow::{Context as _, Result, ensure};
use std::fmt::Write as _;

use super::prose::{Naming, Words, lines};
use super::schema::{Bit, BitValue, Bits, Element, Enumeration, EnumerationValue, Factor, Field, Message, Schema};
use super::{COMMAND, fill, snake, upper};

/// Names in the header.
pub(crate) struct Names;

impl Naming for Names {
    fn constant(&self, name: &str) -> String {
        format!("RIVET_{name}")
    }

    fn bits(&self, bits: &Bits) -> String {
        format!("RIVET_{}_*", bits.prefix())
    }

    fn bit(&self, bits: &Bits, bit: &Bit) -> String {
        format!("RIVET_{}_{}", bits.prefix(), bit.name)
    }

    fn enumeration(&self, enumeration: &Enumeration) -> String {
        format!("RIVET_{}_*", upper(&enumeration.name))
    }

    fn value(&self, enumeration: &Enumeration, value: &EnumerationValue) -> String {
        format!("RIVET_{}_{}", upper(&enumeration.name), upper(&value.name))
    }

    fn message(&self, message: &Message) -> String {
        format!("rivet_{}_v{}", snake(&message.name), message.version)
    }
}

/// The header by its template.
pub(crate) fn header(schema: &Schema, words: &Words, template: &str) -> Result<String> {
    let parts = [
        ("services", services(schema, words)?),
        ("constants", constants(schema, words)?),
        ("enumerations", enumerations(schema, words)?),
        ("messages", messages(schema, words)?),
    ];
    let made = format!("/* Made by `{COMMAND}` from src/messages and rivet.h.in. Do not edit. */\n");
    Ok(made + &fill(template, &parts)?)
}

/// A comment on lines of its own.
fn comment(words: &Words, doc: &str, indent: &str) -> Result<String> {
    let text =
        lines(&words.paragraphs(doc)?, indent.len() + 6).join(&format!("\n{indent} * ")).replace(" * \n", " *\n");
    ensure!(!text.contains("*/") && !text.contains("/*"), "{text:?}: it begins or ends a comment of C");
    Ok(format!("{indent}/* {text} */\n"))
}

fn services(schema: &Schema, words: &Words) -> Result<String> {
    let mut text = String::new();
    for service in &schema.services {
        let doc = words.paragraphs(&service.doc).with_context(|| service.name.clone())?.join(" ");
        let entry = lines(&[format!("{}: {doc}", service.name)], 6);
        writeln!(text, " *   {}", entry.join("\n *     "))?;
    }
    Ok(text)
}

fn constants(schema: &Schema, words: &Words) -> Result<String> {
    let mut text = String::new();
    for constant in &schema.constants {
        text += &comment(words, &constant.doc, "").with_context(|| constant.name.clone())?;
        writeln!(text, "#define {} {}", Names.constant(&constant.name), constant.value)?;
    }
    for bits in &schema.bits {
        text.push('\n');
        for bit in &bits.bits {
            let name = Names.bit(bits, bit);
            text += &comment(words, &bit.doc, "").with_context(|| name.clone())?;
            match bit.value {
                BitValue::Bit(place) => writeln!(text, "#define {name} (UINT32_C(1) << {place})")?,
                BitValue::Number(number) => writeln!(text, "#define {name} {number}")?,
            }
        }
    }
    Ok(text)
}

fn enumerations(schema: &Schema, words: &Words) -> Result<String> {
    let mut texts = Vec::new();
    for enumeration in &schema.enumerations {
        let mut text = comment(words, &enumeration.doc, "").with_context(|| enumeration.name.clone())?;
        text.push_str("enum {\n");
        for value in &enumeration.variants {
            let name = Names.value(enumeration, value);
            text += &comment(words, &value.doc, "    ").with_context(|| name.clone())?;
            writeln!(text, "    {name} = {},", value.number)?;
        }
        text.push_str("};\n");
        texts.push(text);
    }
    Ok(texts.join("\n"))
}

fn messages(schema: &Schema, words: &Words) -> Result<String> {
    let mut texts = Vec::new();
    for message in &schema.messages {
        let name = Names.message(message);
        let mut text = comment(words, &message.doc, "").with_context(|| message.name.clone())?;
        writeln!(text, "#define RIVET_{}_TYPE_NAME \"{}\"", upper(&message.name), message.type_name)?;
        text.push_str("typedef struct {\n");
        for field in &message.fields {
            text += &comment(words, &field.doc, "    ").with_context(|| format!("{name}.{}", field.name))?;
            writeln!(text, "    {} {}{};", element(field.element), field.name, length(field))?;
        }
        writeln!(text, "}} {name};\nRIVET_ASSERT(sizeof({name}) == {});", message.size)?;
        for field in &message.fields {
            writeln!(text, "RIVET_ASSERT(offsetof({name}, {}) == {});", field.name, field.offset)?;
        }
        texts.push(text);
    }
    Ok(texts.join("\n"))
}

fn element(element: Element) -> &'static str {
    match element {
        Element::U8 => "uint8_t",
        Element::U32 => "uint32_t",
        Element::U64 => "uint64_t",
        Element::F64 => "double",
    }
}

fn length(field: &Field) -> String {
    let factors = field.length.iter().map(|factor| match factor {
        Factor::Constant(name) => Names.constant(name),
        Factor::Number(number) => number.to_string(),
    });
    let product = factors.collect::<Vec<_>>().join(" * ");
    if product.is_empty() { product } else { format!("[{product}]") }
}
