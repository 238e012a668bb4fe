"""What an instrument reads of an arm: settings, predictions and derivatives."""
