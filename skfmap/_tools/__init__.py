"""Tools that all layers share: checks, work on many shapes, caches, callbacks, warnings."""
