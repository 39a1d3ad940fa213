"""The world core: batched state, one step kernel, events, snapshots."""
