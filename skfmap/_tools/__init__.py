"""Tools that all layers share: checks at the boundary, work on many shapes, caches, callbacks, warnings."""
