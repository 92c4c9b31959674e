//! From a marker file to a pose of each link in each frame by itself: which markers are a link's
//! (`layout`), the rigid pose that they give (`rigid`), what to do where one of them is
//! wrong (`labels`), and whether their noise is white (`whiteness`).

pub(crate) mod labels;
pub(crate) mod layout;
pub(crate) mod rigid;
pub(crate) mod whiteness;
