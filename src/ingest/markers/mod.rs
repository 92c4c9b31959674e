//! From a marker file to a pose of each link in each frame by itself: which markers are a link's
//! (`layout`), the rigid pose that they give (`rigid`), what to do where one of them is
//! wrong (`labels`), and whether their noise is white (`whiteness`).

pub mod labels;
pub mod layout;
pub mod rigid;
pub mod whiteness;
