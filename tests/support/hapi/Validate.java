import ca.uhn.fhir.context.FhirContext;
import ca.uhn.fhir.context.support.DefaultProfileValidationSupport;
import ca.uhn.fhir.validation.FhirValidator;
import ca.uhn.fhir.validation.ResultSeverityEnum;
import ca.uhn.fhir.validation.SingleValidationMessage;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.List;
import java.util.stream.Stream;
import org.hl7.fhir.common.hapi.validation.support.CommonCodeSystemsTerminologyService;
import org.hl7.fhir.common.hapi.validation.support.InMemoryTerminologyServerValidationSupport;
import org.hl7.fhir.common.hapi.validation.support.PrePopulatedValidationSupport;
import org.hl7.fhir.common.hapi.validation.support.SnapshotGeneratingValidationSupport;
import org.hl7.fhir.common.hapi.validation.support.ValidationSupportChain;
import org.hl7.fhir.common.hapi.validation.validator.FhirInstanceValidator;
import org.hl7.fhir.r4.model.CodeSystem;

/** Validates the resources of a folder, with the code systems of another; asks no server. */
public class Validate {
  public static void main(String[] folders) throws Exception {
    FhirContext context = FhirContext.forR4Cached();
    PrePopulatedValidationSupport known = new PrePopulatedValidationSupport(context);
    for (Path file : filesIn(folders[0])) {
      known.addCodeSystem(context.newJsonParser().parseResource(CodeSystem.class, Files.readString(file)));
    }
    FhirInstanceValidator module = new FhirInstanceValidator(new ValidationSupportChain(
        new DefaultProfileValidationSupport(context),
        known,
        new InMemoryTerminologyServerValidationSupport(context),
        new CommonCodeSystemsTerminologyService(context),
        new SnapshotGeneratingValidationSupport(context)));
    module.setErrorForUnknownProfiles(true);
    FhirValidator validator = context.newValidator().registerValidatorModule(module);
    for (Path file : filesIn(folders[1])) {
      for (SingleValidationMessage message : validator.validateWithResult(Files.readString(file)).getMessages()) {
        if (message.getSeverity() != ResultSeverityEnum.INFORMATION) {
          System.out.println(String.join("\t", file.getFileName().toString(),
              message.getSeverity().getCode(), message.getLocationString(),
              message.getMessage().replaceAll("\\s+", " ")));
        }
      }
      System.out.println(file.getFileName() + "\tdone");
    }
  }

  private static List<Path> filesIn(String folder) throws Exception {
    try (Stream<Path> files = Files.list(Path.of(folder))) {
      return files.sorted().toList();
    }
  }
}
