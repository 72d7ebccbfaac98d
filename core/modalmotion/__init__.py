"""Modal signatures and classes of nonrigid motion, from closed-form lattice modes."""
