//! The messages as the sources define them.

use anyhow::{Context as _, Result, bail, ensure};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use syn::parse::{Parse, ParseStream};
use syn::punctuated::Punctuated;
use syn::{
    Attribute, BinOp, Expr, Fields, Ident, ImplItem, Item, ItemConst, ItemEnum, ItemImpl, ItemMod, ItemStruct, Lit,
    Meta, Stmt, Token, Type, Variant, braced,
};

/// The module that [`list`](super::list) writes.
const LIST: &str = "list";

/// Everything that the mirrors contain.
#[derive(Debug, Default)]
pub(crate) struct Schema {
    /// Modules of messages, in the order of their lines in `mod.rs`.
    pub(crate) modules: Vec<String>,
    pub(crate) constants: Vec<Constant>,
    pub(crate) bits: Vec<Bits>,
    pub(crate) enumerations: Vec<Enumeration>,
    pub(crate) messages: Vec<Message>,
    pub(crate) services: Vec<Service>,
}

/// A length of an array.
#[derive(Debug)]
pub(crate) struct Constant {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) value: u64,
}

/// A module of bits: `faults`.
#[derive(Debug)]
pub(crate) struct Bits {
    pub(crate) module: String,
    pub(crate) bits: Vec<Bit>,
}

impl Bits {
    /// First part of the names in C and Python: the last word of the module's name, in the singular.
    pub(crate) fn prefix(&self) -> String {
        let word = self.module.rsplit('_').next().unwrap_or_default();
        word.trim_end_matches('s').to_uppercase()
    }
}

#[derive(Debug)]
pub(crate) struct Bit {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) value: BitValue,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum BitValue {
    /// `1 << n`
    Bit(u64),
    Number(u64),
}

#[derive(Debug)]
pub(crate) struct Enumeration {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) variants: Vec<EnumerationValue>,
}

#[derive(Debug)]
pub(crate) struct EnumerationValue {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) number: u64,
}

#[derive(Debug)]
pub(crate) struct Message {
    pub(crate) name: String,
    pub(crate) doc: String,
    /// `rivet.JointState.v1`
    pub(crate) type_name: String,
    pub(crate) version: u32,
    /// Size \[bytes\].
    pub(crate) size: u64,
    pub(crate) fields: Vec<Field>,
}

#[derive(Debug)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) element: Element,
    /// Factors of the array's length; empty where the field is no array.
    pub(crate) length: Vec<Factor>,
    /// Offset \[bytes\].
    pub(crate) offset: u64,
}

/// A factor of an array's length.
#[derive(Debug)]
pub(crate) enum Factor {
    Constant(String),
    Number(u64),
}

/// A type of a number in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    U32,
    U64,
    F64,
}

impl Element {
    fn new(name: &Ident) -> Result<Element> {
        Ok(match name.to_string().as_str() {
            "u8" => Element::U8,
            "u32" => Element::U32,
            "u64" => Element::U64,
            "f64" => Element::F64,
            other => bail!("{other}: a field has u8, u32, u64, f64 or an array of them"),
        })
    }

    /// Size and alignment \[bytes\].
    fn size(self) -> u64 {
        match self {
            Element::U8 => 1,
            Element::U32 => 4,
            Element::U64 | Element::F64 => 8,
        }
    }
}

/// A service of a robot.
#[derive(Debug)]
pub(crate) struct Service {
    pub(crate) name: String,
    pub(crate) doc: String,
}

/// What stands between the brackets of `wire_enum!`.
struct WireEnum {
    attributes: Vec<Attribute>,
    name: Ident,
    variants: Punctuated<Variant, Token![,]>,
}

impl Parse for WireEnum {
    fn parse(input: ParseStream<'_>) -> syn::Result<WireEnum> {
        let (attributes, name) = (input.call(Attribute::parse_outer)?, input.parse()?);
        if input.parse::<Option<Token![as]>>()?.is_some() {
            input.parse::<Ident>()?;
        }
        let body;
        braced!(body in input);
        Ok(WireEnum { attributes, name, variants: Punctuated::parse_terminated(&body)? })
    }
}

impl Schema {
    /// Reads the modules that `mod.rs` of the folder names, and the services.
    pub(crate) fn read(folder: &Path, services: &Path) -> Result<Schema> {
        let source = |path: &Path| fs::read_to_string(path).with_context(|| path.display().to_string());
        let mut schema = Schema::default();
        let top = folder.join("mod.rs");
        schema.add(&source(&top)?).with_context(|| top.display().to_string())?;
        for module in schema.modules.clone() {
            let path = folder.join(&module).with_extension("rs");
            schema.add(&source(&path)?).with_context(|| path.display().to_string())?;
        }
        schema.services = read_services(&source(services)?).with_context(|| services.display().to_string())?;
        Ok(schema)
    }

    /// Takes in a source file.
    ///
    /// # Errors
    /// A message that C and Python cannot mirror.
    pub(crate) fn add(&mut self, source: &str) -> Result<()> {
        let items = syn::parse_file(source)?.items;
        // Lengths first: a message may stand before them.
        for item in &items {
            match item {
                Item::Const(constant) if is_public(&constant.vis) => self.add_constant(constant)?,
                Item::Mod(module) => self.add_module(module)?,
                _ => {}
            }
        }
        for item in &items {
            match item {
                Item::Struct(message) => self.add_message(message).with_context(|| message.ident.to_string())?,
                Item::Macro(call) if call.mac.path.is_ident("wire_enum") => {
                    let WireEnum { attributes, name, variants } = call.mac.parse_body()?;
                    let name = name.to_string();
                    let variants = variants.iter().map(value).collect::<Result<_>>().with_context(|| name.clone())?;
                    self.enumerations.push(Enumeration { name, doc: doc(&attributes), variants });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn add_constant(&mut self, constant: &ItemConst) -> Result<()> {
        let name = constant.ident.to_string();
        let value = product(&constant.expr).and_then(|factors| self.length(&factors)).with_context(|| name.clone())?;
        self.constants.push(Constant { name, doc: doc(&constant.attrs), value });
        Ok(())
    }

    /// A module of messages, or one of bits.
    fn add_module(&mut self, module: &ItemMod) -> Result<()> {
        let name = module.ident.to_string();
        let Some((_, items)) = &module.content else {
            if name != LIST {
                self.modules.push(name);
            }
            return Ok(());
        };
        if is_public(&module.vis) {
            let bits = items.iter().filter_map(|item| if let Item::Const(bit) = item { Some(bit) } else { None });
            let bits = bits.map(bit).collect::<Result<_>>().with_context(|| name.clone())?;
            self.bits.push(Bits { module: name, bits });
        }
        Ok(())
    }

    fn add_message(&mut self, message: &ItemStruct) -> Result<()> {
        let Some(type_name) = attribute(&message.attrs, "type_name") else { return Ok(()) };
        let type_name: String = type_name.parse_args::<syn::LitStr>()?.value();
        let name = message.ident.to_string();
        let version = type_name.strip_prefix(&format!("rivet.{name}.v")).and_then(|version| version.parse().ok());
        let version = version.with_context(|| format!("type_name {type_name:?}: it must be rivet.{name}.v<number>"))?;
        let representation = attribute(&message.attrs, "repr").context("it needs #[repr(C)]")?;
        ensure!(representation.parse_args::<Ident>()? == "C", "it needs #[repr(C)]");
        let Fields::Named(named) = &message.fields else { bail!("its fields need names") };
        let (mut fields, mut end, mut widest) = (Vec::new(), 0_u64, 1);
        for field in &named.named {
            let name = field.ident.as_ref().context("a name")?.to_string();
            let (element, length) = element(&field.ty).with_context(|| name.clone())?;
            ensure!(end.is_multiple_of(element.size()), "padding before {name}: spell it out as a field of zeros");
            widest = widest.max(element.size());
            let offset = end;
            end += element.size() * self.length(&length).with_context(|| name.clone())?;
            fields.push(Field { name, doc: doc(&field.attrs), element, length, offset });
        }
        ensure!(end.is_multiple_of(widest), "padding at the end: spell it out as a field of zeros");
        self.messages.push(Message { name, doc: doc(&message.attrs), type_name, version, size: end, fields });
        Ok(())
    }

    /// The product of factors.
    fn length(&self, factors: &[Factor]) -> Result<u64> {
        factors.iter().try_fold(1, |length, factor| match factor {
            Factor::Number(number) => Ok(length * number),
            Factor::Constant(name) => {
                let constant = self.constants.iter().find(|constant| constant.name == *name);
                Ok(length * constant.with_context(|| format!("{name}: no public constant before this"))?.value)
            }
        })
    }
}

fn is_public(visibility: &syn::Visibility) -> bool {
    matches!(visibility, syn::Visibility::Public(_))
}

fn attribute<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Attribute> {
    attributes.iter().find(|attribute| attribute.path().is_ident(name))
}

/// The doc comment, a line each.
fn doc(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| match &attribute.meta {
        Meta::NameValue(meta) if meta.path.is_ident("doc") => match &meta.value {
            Expr::Lit(literal) => match &literal.lit {
                Lit::Str(line) => Some(line.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    });
    lines.collect::<Vec<_>>().join("\n")
}

fn number(expression: &Expr) -> Result<u64> {
    match expression {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Int(number) => Ok(number.base10_parse()?),
            _ => bail!("not a whole number"),
        },
        _ => bail!("not a number"),
    }
}

/// Factors of `A * B`.
fn product(expression: &Expr) -> Result<Vec<Factor>> {
    Ok(match expression {
        Expr::Path(path) => vec![Factor::Constant(path.path.require_ident()?.to_string())],
        Expr::Binary(binary) if matches!(binary.op, BinOp::Mul(_)) => {
            let mut factors = product(&binary.left)?;
            factors.extend(product(&binary.right)?);
            factors
        }
        other => vec![Factor::Number(number(other).context("a length is a product of numbers and constants")?)],
    })
}

/// A field's number type, and the factors of its length.
fn element(kind: &Type) -> Result<(Element, Vec<Factor>)> {
    match kind {
        Type::Path(path) => Ok((Element::new(path.path.require_ident()?)?, Vec::new())),
        Type::Array(array) => {
            let (element, inner) = element(&array.elem)?;
            ensure!(inner.is_empty(), "an array of arrays: write it as one array");
            Ok((element, product(&array.len)?))
        }
        _ => bail!("a field has a number or an array of numbers"),
    }
}

fn bit(constant: &ItemConst) -> Result<Bit> {
    let value = match &*constant.expr {
        Expr::Binary(binary) if matches!(binary.op, BinOp::Shl(_)) && number(&binary.left)? == 1 => {
            BitValue::Bit(number(&binary.right)?)
        }
        other => BitValue::Number(number(other)?),
    };
    Ok(Bit { name: constant.ident.to_string(), doc: doc(&constant.attrs), value })
}

fn value(variant: &Variant) -> Result<EnumerationValue> {
    let name = variant.ident.to_string();
    let (_, expression) = variant.discriminant.as_ref().with_context(|| format!("{name} has no number"))?;
    Ok(EnumerationValue { number: number(expression)?, doc: doc(&variant.attrs), name })
}

/// The services by the enumeration `Service` and its `as_str`.
fn read_services(source: &str) -> Result<Vec<Service>> {
    let items = syn::parse_file(source)?.items;
    let is_service = |item: &&ItemEnum| item.ident == "Service";
    let variants = items.iter().filter_map(|item| if let Item::Enum(item) = item { Some(item) } else { None });
    let variants = &variants.into_iter().find(is_service).context("no enumeration Service")?.variants;
    let names = items.iter().find_map(|item| if let Item::Impl(item) = item { names(item) } else { None });
    let names = names.context("no as_str with a match of names")?;
    let service = |variant: &Variant| {
        let name = names.get(&variant.ident.to_string()).with_context(|| format!("{} has no name", variant.ident))?;
        Ok(Service { name: name.clone(), doc: doc(&variant.attrs) })
    };
    variants.iter().map(service).collect()
}

/// Names by variants, if this block has `as_str`.
fn names(block: &ItemImpl) -> Option<BTreeMap<String, String>> {
    let body = block.items.iter().find_map(|item| match item {
        ImplItem::Fn(function) if function.sig.ident == "as_str" => function.block.stmts.last(),
        _ => None,
    })?;
    let Stmt::Expr(Expr::Match(choice), _) = body else { return None };
    let arms = choice.arms.iter().map(|arm| match (&arm.pat, &*arm.body) {
        (syn::Pat::Path(variant), Expr::Lit(literal)) => match &literal.lit {
            Lit::Str(name) => Some((variant.path.segments.last()?.ident.to_string(), name.value())),
            _ => None,
        },
        _ => None,
    });
    arms.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(source: &str) -> Result<Schema> {
        let mut schema = Schema::default();
        schema.add(source).map(|()| schema)
    }

    fn refusal(source: &str) -> String {
        format!("{:#}", read(source).expect_err("refused"))
    }

    #[test]
    fn offsets_follow_from_types_and_lengths() {
        let source =
            "#[type_name(\"rivet.A.v3\")] #[repr(C)] pub struct A { pub a: [u8; 2 * N], pub b: u32, pub c: f64 }
             pub const N: usize = 2;";
        let schema = read(source).expect("sound");
        let message = &schema.messages[0];
        assert_eq!((message.version, message.size), (3, 16));
        assert_eq!(message.fields.iter().map(|field| field.offset).collect::<Vec<_>>(), [0, 4, 8]);
    }

    #[test]
    fn what_has_no_mirror_is_refused() {
        let message = |type_name: &str, fields: &str| {
            refusal(&format!("#[type_name(\"{type_name}\")] #[repr(C)] pub struct A {{ {fields} }}"))
        };
        assert!(message("rivet.A.v1", "a: u32, b: f64").contains("padding before b"));
        assert!(message("rivet.A.v1", "a: f64, b: u32").contains("padding at the end"));
        assert!(message("rivet.A.v1", "a: bool").contains("bool"));
        assert!(message("rivet.A.v1", "a: [f64; M]").contains("M: no public constant"));
        assert!(message("rivet.B.v1", "a: u64").contains("rivet.A.v<number>"));
        assert!(refusal("#[type_name(\"rivet.A.v1\")] pub struct A { a: u64 }").contains("repr(C)"));
        assert!(refusal("wire_enum!(A { B });").contains("B has no number"));
    }

    #[test]
    fn bits_are_named_after_their_module() {
        let schema = read("pub mod parameter_flags { pub const LATE: u32 = 1 << 4; pub const AT: u32 = 8; }");
        let bits = &schema.expect("sound").bits[0];
        assert_eq!(bits.prefix(), "FLAG");
        assert!(matches!(bits.bits[0].value, BitValue::Bit(4)));
        assert!(matches!(bits.bits[1].value, BitValue::Number(8)));
    }
}
