"""Another finger in a moment: fingers alike but for the moduli of dermis and fat, between full builds."""
