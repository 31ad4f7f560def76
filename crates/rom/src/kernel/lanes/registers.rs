//! [`Lanes`](super::Lanes) over registers of a processor, from the intrinsics of their instruction set.

/// Defines the lanes of an instruction set: registers, their f32, what guarantees it, and its intrinsics, one call a register.
macro_rules! registers {
    (
        $(#[doc = $about:literal])+
        $name:ident: $register:ty, $width:literal;
        splat $splat:expr, load $load:expr, load_words $load_words:expr, low $low:expr, to_floats $to_floats:expr, store $store:expr;
        mul_add $mul_add:expr, add $add:expr, sqrt $sqrt:expr, at_least_zero $at_least_zero:expr, select_greater $select:expr;
    ) => {
        use super::super::TILE_NODES;

        const WIDTH: usize = $width;
        const REGISTERS: usize = TILE_NODES / WIDTH;
        const HALF: usize = REGISTERS / 2;

        $(#[doc = $about])+
        #[derive(Clone, Copy)]
        pub(in super::super) struct $name([$register; REGISTERS]);

        /// One value a register; the loop is unrolled.
        #[inline(always)]
        unsafe fn each(register: impl Fn(usize) -> $register) -> $name {
            // SAFETY: the caller has the instruction set.
            let mut all = [unsafe { $splat(0.0) }; REGISTERS];
            for (r, one) in all.iter_mut().enumerate() {
                *one = register(r);
            }
            $name(all)
        }

        // SAFETY (all methods): the trait's contract gives the instruction set and valid, aligned pointers to a row, of which register
        // r takes the elements from r WIDTH on.
        impl super::Lanes for $name {
            #[inline(always)]
            unsafe fn splat(value: f32) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|_| $splat(value)) }
            }

            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $load(from.add(r * WIDTH))) }
            }

            #[inline(always)]
            unsafe fn load_pairs(from: *const i32) -> Self {
                // SAFETY: see the impl.
                unsafe {
                    each(|r| {
                        let (words, low) = if r < HALF { (r, true) } else { (r - HALF, false) };
                        let pairs = $load_words(from.add(words * WIDTH).cast());
                        $to_floats(if low { $low(pairs) } else { pairs })
                    })
                }
            }

            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                for (r, register) in self.0.into_iter().enumerate() {
                    // SAFETY: see the impl.
                    unsafe { $store(to.add(r * WIDTH), register) }
                }
            }

            #[inline(always)]
            unsafe fn mul_add(self, factor: Self, addend: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $mul_add(self.0[r], factor.0[r], addend.0[r])) }
            }

            #[inline(always)]
            unsafe fn add(self, other: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $add(self.0[r], other.0[r])) }
            }

            #[inline(always)]
            unsafe fn sqrt(self) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $sqrt(self.0[r])) }
            }

            #[inline(always)]
            unsafe fn at_least_zero(self) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $at_least_zero($splat(0.0), self.0[r])) }
            }

            #[inline(always)]
            unsafe fn select_greater(self, than: Self, yes: Self, no: Self) -> Self {
                // SAFETY: see the impl.
                unsafe { each(|r| $select(self.0[r], than.0[r], yes.0[r], no.0[r])) }
            }
        }
    };
}
pub(super) use registers;
