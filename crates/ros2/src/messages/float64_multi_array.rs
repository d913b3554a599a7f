//! `std_msgs/Float64MultiArray`

use serde::{Deserialize, Serialize};

/// Numbers with named dimensions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// What the numbers are.
    pub layout: MultiArrayLayout,
    /// `layout.data_offset` numbers, then the array, last dimension fastest.
    pub data: Vec<f64>,
}

/// `std_msgs/MultiArrayLayout`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayLayout {
    /// Outermost dimension first.
    pub dim: Vec<MultiArrayDimension>,
    /// Numbers before the array.
    pub data_offset: u32,
}

/// `std_msgs/MultiArrayDimension`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayDimension {
    /// What the dimension is.
    pub label: String,
    /// Entries.
    pub size: u32,
    /// Numbers from this dimension inwards.
    pub stride: u32,
}

super::ros_message!(Float64MultiArray, "std_msgs", "Float64MultiArray");
